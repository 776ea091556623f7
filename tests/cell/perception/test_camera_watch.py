"""A camera that moves in a fold is told from the scene, whatever its light; nothing
else is.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cell.perception.camera_watch import (
    CAMERA_WATCHED,
    FEWEST_PATCHES,
    UNWATCHED,
    CameraWatch,
)
from cell.perception.image_reader import Measurer, StripInputs
from cell.perception.preflight import inspect
from cell.perception.region import HIGH_HEIGHT
from drivers.base.types import Array, Frame, Image, Pose
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.rendered_cell import flat, lying
from tests.support.requests import DENIM
from tests.support.twin_calibration import twin_calibration

CAMERA = CameraSettings()
CALIBRATION = twin_calibration(CAMERA)
WAITING, ABOVE = Pose(0.65, 0.25, 0.0), Pose(0.3, 0.3, np.pi / 2)


def picture(points: Array, gripper: Pose, seed: int) -> Image:
    renderer = Renderer(CAMERA, StripLook.from_file(DENIM), seed)
    image = renderer.render([lying(points, gripper)], seed)
    image[440:500, 1190:1250] //= (
        1 + np.indices((60, 60), np.uint8).sum(0)[..., None] // 8 % 2
    )
    return image


def before() -> Frame:
    """The frame before the grasp."""
    return Frame(0.0, 0.0, "test", 0, picture(flat(), WAITING, 0))


@pytest.fixture(scope="module")
def watch() -> CameraWatch:
    seen = inspect(before(), CALIBRATION, DENIM)
    return CameraWatch.choose(seen.appearance, CALIBRATION, DENIM)


@pytest.fixture(scope="module")
def lifted() -> Image:
    desk, hanging = np.linspace(0, 0.3, 31), np.linspace(0.01, 0.3, 30)
    points = np.concatenate([[(x, 0.0) for x in desk], [(0.3, z) for z in hanging]])
    return picture(points, ABOVE, 1)


def moved(image: Image, x: float, z: float) -> Image:
    """`image` as of a camera that was moved so that all appears `x`, `z` [m]
    elsewhere.
    """
    here, there = CALIBRATION.to_image(np.array([(0.2, 0.0), (0.2 + x, z)]))
    warp = np.column_stack([np.eye(2), there - here])
    size = image.shape[1::-1]
    return cv2.warpAffine(image, warp, size, borderMode=cv2.BORDER_REPLICATE)


def test_a_lifted_strip_and_other_light_move_nothing(
    watch: CameraWatch, lifted: Image
) -> None:
    assert len(watch.patches) >= FEWEST_PATCHES
    assert watch.shift(lifted, ABOVE) < 3e-4
    assert watch.shift(lifted // 2, ABOVE) < 3e-4


def test_patches_lie_apart_and_below_the_waiting_hand(watch: CameraWatch) -> None:
    apart = np.abs(watch.corners[:, None] - watch.corners).max(axis=2)
    assert (apart >= len(watch.patches[0])).sum() == len(apart) * (len(apart) - 1)
    hand = CALIBRATION.to_image(np.array([[DENIM.length / 2, HIGH_HEIGHT]]))
    assert watch.corners[:, 1].min() > hand[0, 1]


@pytest.mark.parametrize(("x", "z"), [(0.002, 0.0), (-0.0015, 0.001), (0.0, 0.004)])
def test_a_moved_camera_is_told(
    watch: CameraWatch, lifted: Image, x: float, z: float
) -> None:
    shift = watch.shift(moved(lifted, x, z), ABOVE)
    assert shift == pytest.approx(np.hypot(x, z), abs=4e-4)


def test_where_nothing_is_found_again_nothing_is_told(
    watch: CameraWatch, lifted: Image
) -> None:
    assert np.isnan(watch.shift(np.full_like(lifted, 255), ABOVE))
    assert np.isnan(watch.shift(moved(lifted, 0.03, 0.0), ABOVE))


def test_what_stands_still_is_a_check_and_too_little_of_it_is_said(
    watch: CameraWatch,
) -> None:
    found = watch.check()
    assert (found.name, found.passed) == (CAMERA_WATCHED, True)
    one = replace(watch, corners=watch.corners[:1], patches=watch.patches[:1])
    found = one.check()
    assert (found.name, found.passed) == (UNWATCHED, True)
    assert found.reason.startswith(
        "1 static patches are visible, 2 are needed: a camera"
    )


def test_process_beside_the_loop_says_so_too() -> None:
    sight = Measurer(StripInputs(CALIBRATION, DENIM))
    assert sight.inspect(before())[-1].name == CAMERA_WATCHED
