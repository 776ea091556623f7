"""Calibration of the twin's camera from its own images of boards and touched points.

`python -m tests.support.twin_calibration` writes the one that comes with the shipped
settings.
"""

from functools import lru_cache

from calibration.board import BoardSettings
from calibration.calibration import (
    Calibration,
    load_calibration,
    make_calibration,
    save_calibration,
)
from calibration.lens import Lens
from calibration.wizard.board_views import BoardViews
from calibration.wizard.lens_verdict import LensVerdict
from calibration.wizard.touch_verdict import TouchVerdict
from calibration.wizard.touched_points import TouchedPoints
from calibration.wizard.touches import TouchSettings
from cell.base.config.places import CHECKOUT_CONFIGS, Configs
from cell.setup.calibration_in_use import calibration_file
from cell.setup.wizard import calibrate_twin
from drivers.base.errors import Fault
from drivers.base.types import Frame, Pose
from drivers.twin.board import board_frame, board_pose
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.rendered_cell import empty

SHIPPED = CHECKOUT_CONFIGS / "calibration"
NO_STRIP = StripLook((40, 60, 110), 0.001, 0.05)


@lru_cache
def true_lens(camera: CameraSettings = CameraSettings()) -> Lens:  # noqa: B008  frozen
    """Lens that the twin renders with."""
    optics = Optics.from_settings(camera)
    size = (1280, 720)
    return Lens.pinhole(size, optics.focal, optics.principal, optics.distortion)


def show_boards(
    camera: CameraSettings, settings: BoardSettings, seed: int = 1
) -> LensVerdict:
    """Lens estimate from all wanted board views, rendered by the twin's camera."""
    views = BoardViews(settings, (camera.width, camera.height))
    sequence = 0
    while (wanted := views.ask()) is not None:
        pose = board_pose(camera, settings.board(), wanted)
        views.tell(board_frame(camera, settings.board(), pose, seed, sequence=sequence))
        sequence += 1
    return views.verdict(settings.width)


def pointer_frame(renderer: Renderer, pose: Pose, sequence: int) -> Frame:
    """Frame of the pointer at `pose` in an empty cell."""
    image = renderer.render([empty(pose, pointer=True)], sequence)
    return Frame(0.0, 0.02, "test", sequence, image)


def touch_points(
    camera: CameraSettings, lens: Lens, settings: TouchSettings
) -> TouchVerdict:
    """Homography estimate from all wanted points, touched before the twin's camera."""
    renderer = Renderer(camera, NO_STRIP, 0)
    touched = TouchedPoints(lens, settings)
    sequence = 0
    while (pose := touched.ask()) is not None:
        touched.tell(pointer_frame(renderer, pose, sequence), pose)
        sequence += 1
    return touched.verdict()


@lru_cache
def twin_calibration(camera: CameraSettings) -> Calibration:
    """Lens and homography of the twin's camera, estimated from rendered images.

    Raises Fault where the wizards refuse them.
    """
    if camera == CameraSettings():
        (shipped,) = SHIPPED.iterdir()
        return load_calibration(shipped)
    lens = show_boards(camera, BoardSettings())
    if not lens.passed or lens.fit is None:
        raise Fault("calibration_refused", "; ".join(lens.reasons))
    plane = touch_points(camera, lens.fit.lens, TouchSettings())
    if not plane.passed or plane.plane_map is None:
        raise Fault("calibration_refused", "; ".join(plane.reasons))
    return make_calibration(
        lens.fit.lens,
        plane.plane_map.homography,
        residual_mm=plane.residual_mm,
        date="2026-01-01T00:00:00Z",
        camera=camera.identity,
    )


def ship_calibration() -> None:
    """Calibrate the shipped cell's twin, and overwrite the shipped calibration."""
    settings = Configs(CHECKOUT_CONFIGS).cell()
    made = calibrate_twin(settings, lambda: False)
    SHIPPED.mkdir(exist_ok=True)
    for old in SHIPPED.iterdir():
        old.unlink()
    save_calibration(made, SHIPPED / calibration_file(settings).name)


if __name__ == "__main__":
    ship_calibration()
