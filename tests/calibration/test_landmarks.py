"""A camera that was nudged after its calibration is noticed, by millimetres."""

from functools import lru_cache

import numpy as np
import pytest

from calibration.homography import Homography, PlaneMap
from calibration.landmarks import (
    CameraShift,
    Landmark,
    Landmarks,
    LandmarkSettings,
    camera_shift,
    find_patch,
    take_landmarks,
)
from cell.perception.preflight import camera_check
from drivers.base.errors import ConfigurationError
from drivers.base.types import Frame
from drivers.strip.model import Observation
from drivers.twin.camera import displaced_optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.rendered_cell import empty
from tests.support.twin_calibration import NO_STRIP, twin_calibration

CAMERA = CameraSettings()
SETTINGS = LandmarkSettings()
EMPTY = empty(SETTINGS.pose)
VIEW = twin_calibration(CAMERA)


def _frame(shift: tuple[float, float] = (0.0, 0.0), seed: int = 0) -> Frame:
    """The empty hand where it is remembered, the camera nudged by `shift` [m] in x,
    z.
    """
    moved = displaced_optics(
        CAMERA, Observation(shift_x=shift[0], shift_z=shift[1]), 0.0
    )
    renderer = Renderer(CAMERA, NO_STRIP, seed, moved)
    return Frame(0.0, 0.02, "test", seed, renderer.render([EMPTY], seed))


@lru_cache
def _landmarks() -> Landmarks:
    return take_landmarks(_frame(), SETTINGS.pose, VIEW)


def _shift(frame: Frame) -> CameraShift:
    return camera_shift(frame, _landmarks(), VIEW)


def test_camera_that_stayed_is_where_it_was_within_a_tenth_of_a_millimetre() -> None:
    shift = _shift(_frame(seed=7))
    assert shift.distance < 0.1
    assert camera_check(shift, SETTINGS).passed


@pytest.mark.parametrize(
    "nudge", [(0.005, 0.0), (-0.005, 0.0), (0.0, 0.005), (0.003, -0.004)]
)
def test_camera_nudged_by_five_millimetres_is_noticed(
    nudge: tuple[float, float],
) -> None:
    shift = _shift(_frame(nudge, seed=7))
    assert (shift.x, shift.z) == pytest.approx(
        (1e3 * nudge[0], 1e3 * nudge[1]), abs=0.4
    )
    assert shift.desk == pytest.approx(1e3 * nudge[1], abs=1.0)
    check = camera_check(shift, SETTINGS)
    assert not check.passed
    assert "the gripper appears moved by x" in check.reason
    assert "calibrate again" in check.remedy


def test_hand_that_is_not_seen_again_is_refused() -> None:
    dark = np.full((720, 1280, 3), 30, np.uint8)
    # nor anything without contrast
    assert find_patch(dark[..., 0], dark[:40, :40, 0]) is None
    shift = _shift(Frame(0.0, 0.0, "test", 0, dark))
    assert np.isnan(shift.x)
    check = camera_check(shift, SETTINGS)
    assert not check.passed
    assert "the gripper is not seen there" in check.reason


def test_desk_at_the_border_or_without_an_edge_is_no_landmark() -> None:
    lower = VIEW.homography.matrix @ [[1, 0, 0], [0, 1, -90], [0, 0, 1]]  # by 90 px
    low_view = PlaneMap(VIEW.lens, Homography.from_matrix(lower))
    at_border = np.roll(_frame().image, 90, axis=0)
    for image, view in ((at_border, low_view), (np.full_like(at_border, 90), VIEW)):
        frame = Frame(0.0, 0.0, "test", 0, image)
        found = take_landmarks(frame, SETTINGS.pose, view)
        assert [mark.kind for mark in found.marks] == ["tip"]


def test_broken_landmark_is_refused_in_one_line() -> None:
    for content in ("not base64!", "aGVsbG8="):
        with pytest.raises(
            ConfigurationError, match="png: is not a PNG image; calibrate again"
        ):
            Landmark(kind="tip", left=0, top=0, png=content).patch()
