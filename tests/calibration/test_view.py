"""A camera that moved is told from the scene, whatever its light; nothing else is."""

import re
from functools import lru_cache
from math import hypot

import cv2
import numpy as np
import pytest

from calibration.view import Landmarks, LandmarkSettings, PinnedView
from cell.perception.image_reader import Measurer, StripInputs
from cell.perception.preflight import (
    CAMERA_WATCHED,
    UNWATCHED,
    check_camera,
    check_watch,
)
from cell.perception.region import Region, still_surroundings, without_hand
from cell.setup.camera_check import check_views
from drivers.base.types import Frame, Image, Pose
from drivers.strip.model import ObservationModel
from drivers.twin.camera import displaced_optics
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from drivers.twin.world import WorldState
from tests.support.rendered_cell import KNOTS, empty, flat, lying, scene
from tests.support.requests import DENIM
from tests.support.twin_calibration import twin_calibration

CAMERA = CameraSettings()
VIEW = twin_calibration(CAMERA)
SETTINGS = LandmarkSettings()
AWAY, ABOVE = Pose(0.2, 0.9, 0.0), Pose(0.3, 0.3, np.pi / 2)
WAITING = lying(flat(), Pose(0.65, 0.25, 0.0))


@lru_cache(maxsize=4)
def _renderer(camera: CameraSettings, moved: ObservationModel) -> Renderer:
    optics = displaced_optics(camera, moved, 0.0)
    return Renderer(camera, StripLook.from_file(DENIM), 0, optics)


def picture(
    seen: WorldState,
    sequence: int = 0,
    camera: CameraSettings = CAMERA,
    **moved: float,
) -> Image:
    """The scene `seen` by a camera that `moved` by shift_x, shift_z [m] and scale."""
    return _renderer(camera, ObservationModel(**moved)).render([seen], sequence)


def frame(image: Image) -> Frame:
    return Frame(0.0, 0.02, "test", 0, image)


def check(pinned: Image, now: Image, *, calibrated: bool = True):
    return check_views(pinned, [frame(now)], VIEW if calibrated else None)


def turned(image: Image, degrees: float, zoom: float) -> Image:
    """`image` turned and enlarged about its middle."""
    h, w, _ = image.shape
    warp = cv2.getRotationMatrix2D((w / 2, h / 2), degrees, zoom)
    return cv2.warpAffine(image, warp, (w, h), borderMode=cv2.BORDER_REPLICATE)


@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize("shift", [(0.0005, 0.0), (0.0, -0.0005), (0.004, 0.003)])
def test_half_a_millimetre_is_told(
    shift: tuple[float, float], calibrated: bool
) -> None:
    now = picture(scene("high"), 1, shift_x=shift[0], shift_z=shift[1])
    found = check(picture(WAITING), now, calibrated=calibrated)
    assert not found.passed
    if calibrated:
        assert found.distance == pytest.approx(hypot(*shift), abs=2.5e-4)


@pytest.mark.parametrize(("degrees", "zoom"), [(0.1, 1.0), (0.0, 1.003)])
def test_turn_and_zoom_are_told_by_their_largest_shift(
    degrees: float, zoom: float
) -> None:
    now = turned(picture(scene("lifted"), 1), degrees, zoom)
    found = check(picture(empty(AWAY)), now)
    reach = hypot(0.4 * 1280, 0.4 * 720)
    truth = reach * (np.deg2rad(degrees) + zoom - 1)
    assert found.pixels == pytest.approx(truth, abs=0.5)
    assert not found.passed


def test_view_that_is_not_found_again_is_no_camera_that_stayed() -> None:
    dark = np.full((720, 1280, 3), 30, np.uint8)
    found = check(picture(empty(AWAY)), dark)
    assert not found.passed
    assert "is not found again" in found.sentence()


def test_level_edge_alone_shows_no_sideways_motion() -> None:
    edge = np.full((720, 1280, 3), 60, np.uint8)
    edge[400:] = 160
    assert PinnedView.choose(edge).motion(np.roll(edge, 5, axis=1)) is None


def test_hand_at_the_known_pose_shows_a_moved_camera_to_the_preflight() -> None:
    hand = empty(SETTINGS.pose)
    landmarks = Landmarks.take(picture(hand), SETTINGS.pose)

    def checked(image: Image):
        return check_camera(image, landmarks, VIEW, DENIM, SETTINGS)

    assert checked(picture(hand, 7)).passed
    moved = checked(picture(hand, 7, shift_x=0.003, shift_z=-0.004))
    assert not moved.passed
    told = [float(number) for number in re.findall(r"[+-]?\d+\.\d", moved.reason)]
    assert told == pytest.approx([3.0, -4.0, 5.0, 2.5], abs=0.4)
    lower = picture(empty(Pose(SETTINGS.x, SETTINGS.z - 0.004, SETTINGS.pitch)))
    assert not checked(lower).passed
    assert "is not seen there" in checked(picture(empty(AWAY))).reason


def test_fold_watches_the_camera_and_says_where_it_cannot() -> None:
    sight = Measurer(StripInputs(VIEW, DENIM))
    assert sight.inspect(frame(picture(WAITING)))[-1].name == CAMERA_WATCHED
    bare = np.full((720, 1280, 3), 90, np.uint8)
    found = check_watch(PinnedView.choose(bare), bare)
    assert (found.name, found.passed) == (UNWATCHED, True)


def test_nudge_in_a_fold_is_told_beside_strip_and_hand() -> None:
    still = still_surroundings(VIEW, DENIM.length)
    view = PinnedView.choose(picture(WAITING), still, 20)
    image = picture(scene("closing"), 2, shift_x=0.0015, shift_z=0.001)
    clear = without_hand(Region.whole(image), VIEW, scene("closing").gripper)
    moved = view.motion(image, clear, 12).largest_in_plane(VIEW)
    assert moved == pytest.approx(hypot(0.0015, 0.001), abs=4e-4)


@pytest.mark.slow
def test_no_false_alarm_in_200_pairs_and_each_shift_of_a_pixel_is_told() -> None:
    """Other light, strip and hand; the shift is 0.6 mm, a pixel, in any direction."""
    rng = np.random.default_rng(3)
    seen = [scene(kind) for kind in KNOTS] + [WAITING, empty(AWAY), empty(ABOVE)]
    images = []
    moved = []
    for number in range(20):
        light = {
            "gain": rng.uniform(0.7, 1.25),
            "light_gradient": rng.uniform(0.0, 0.3),
            "vignetting": rng.uniform(0.0, 0.25),
            "shadow": rng.uniform(0.0, 0.6),
        }
        camera = CAMERA.model_copy(update=light)
        x, z = 0.0006 * np.array([np.cos(number), np.sin(number)])
        first, *others = rng.permutation(len(seen))[:3]
        images += [picture(seen[i], 3 * number + i, camera) for i in (first, *others)]
        moved.append(picture(seen[first], number, camera, shift_x=x, shift_z=z))
    pairs = rng.permutation(3 * 20 * (3 * 20 - 1))[:200]
    alarms = 0
    for i, j in ((pair % 60, pair // 60) for pair in pairs.tolist()):
        alarms += not check(images[i], images[j]).passed
    missed = [check(images[i], now).passed for i, now in enumerate(moved)]
    assert (alarms, sum(missed)) == (0, 0)
