"""Study of the calibration wizards' accuracy: cameras at random places, outliers, known
latencies.

Every camera is calibrated through rendered boards and rendered touches alone; a tenth
of the touches is wild by 4 to 40 mm, the arm is uncertain by 0.1 mm. Errors are those
of the map over a dense grid of the work area, against the true camera.
"""

from dataclasses import replace

import numpy as np

from calibration.board import BoardSettings
from calibration.lens import Lens
from calibration.wizard.touch_verdict import TouchVerdict
from calibration.wizard.touched_points import TouchedPoints
from calibration.wizard.touches import TouchSettings
from drivers.base.types import Array
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.lab.studies.study import Quantity, Statistic, Study, Values
from tests.support.twin_calibration import NO_STRIP, pointer_frame, show_boards

OUTLIER_SHARE, ARM_NOISE = 0.10, 1e-4  # share of touches; m
TOUCHES = TouchSettings()
SLIP_RANGE, LOWEST_TOUCH = (0.004, 0.04), 0.01  # m, of a wild touch; m over the desk
EDGE_MARGIN = 40  # px from the image's edge to the work area's corners


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw a camera before the work area that sees all of it."""
    while True:
        camera = CameraSettings(
            distance=rng.uniform(1.4, 2.6),
            elevation=np.radians(rng.uniform(1.5, 4.9)),
            aim_x=rng.uniform(0.28, 0.34),
            aim_z=rng.uniform(0.14, 0.18),
            view_width=rng.uniform(0.72, 0.86),
            yaw=rng.uniform(-0.03, 0.03),
            tilt=rng.uniform(-0.02, 0.02),
            roll=rng.uniform(-0.03, 0.03),
            principal=tuple(rng.uniform(-15, 15, 2)),
            distortion=(rng.uniform(-0.3, 0.05), rng.uniform(-0.1, 0.2)),
            lens_blur=rng.uniform(0.5, 1.2),
            noise=rng.uniform(1.0, 4.0),
            gain=rng.uniform(0.85, 1.1),
        )
        seen = Optics.from_settings(camera).plane(_work_area_grid(2))
        high = (camera.width - EDGE_MARGIN, camera.height - EDGE_MARGIN)
        if ((seen > EDGE_MARGIN) & (seen < high)).all():
            return {"camera": camera.model_dump(mode="json"), "noise": number}


def measure(case: Values) -> Values:
    """Median and worst error of the map [m], and why it was refused."""
    camera = CameraSettings.model_validate(case["camera"])
    rng = np.random.default_rng([case["noise"], 1])
    boards = show_boards(camera, BoardSettings(), case["noise"])
    if boards.fit is None:
        return {"refused": True, "reasons": list(boards.reasons)}
    lens = boards.fit.lens
    verdict = _touch_points(camera, lens, rng)
    reasons = [*boards.reasons, *verdict.reasons]
    if verdict.plane_map is None:
        return {"refused": True, "reasons": reasons}
    grid = _work_area_grid(25)
    seen = verdict.plane_map.homography.to_plane(
        lens.undistort(Optics.from_settings(camera).plane(grid))
    )
    errors = np.hypot(*(seen - grid).T)
    return {
        "median": float(np.median(errors)),
        "worst": float(errors.max()),
        "stated": 1e-3 * verdict.residual_mm,
        "refused": bool(boards.reasons),
        "reasons": reasons,
    }


def _work_area_grid(count: int) -> Array:
    """Grid (count^2, 2) [m] over the work area."""
    x = np.linspace(TOUCHES.x_min, TOUCHES.x_max, count)
    z = np.linspace(TOUCHES.z_min, TOUCHES.z_max, count)
    return np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)


def _touch_points(
    camera: CameraSettings, lens: Lens, rng: np.random.Generator
) -> TouchVerdict:
    """Image-to-plane map by the wizard, from rendered touches, of which a share is
    wild.
    """
    renderer, sequence = Renderer(camera, NO_STRIP, int(rng.integers(1 << 30))), 0
    points, slip = TouchedPoints(lens, TOUCHES), np.zeros(2)
    touch: tuple[int | None, bool] = (None, False)
    while (pose := points.ask()) is not None:
        # the images of one touch share its slip
        if (points.number, points.again) != touch:
            touch = (points.number, points.again)
            angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(*SLIP_RANGE)
            way = np.array([np.cos(angle), np.sin(angle)])
            slip = (rng.random() < OUTLIER_SHARE) * size * way
        seen = replace(pose, x=pose.x + slip[0], z=max(pose.z + slip[1], LOWEST_TOUCH))
        x, z = ARM_NOISE * rng.normal(size=2)
        told = replace(pose, x=pose.x + x, z=pose.z + z)
        points.tell(pointer_frame(renderer, seen, sequence), told)
        sequence += 1
    return points.verdict()


STUDY = Study(
    name="wizards",
    question="How exact is the map of the calibration wizards, whatever the camera?",
    draw=draw,
    measure=measure,
    quantities=(
        Quantity("median", Statistic.WORST_SIZE, label="largest median error", bar=0.5),
        Quantity("worst", Statistic.WORST_SIZE, label="worst error", bar=1.0),
        Quantity("stated", Statistic.MEDIAN, label="stated residual"),
        Quantity(
            "refused", Statistic.COUNT, "", 1.0, bar=0.0, label="refused", digits=0
        ),
    ),
    usual=20,
    quick=1,
    seconds=20.0,
)
