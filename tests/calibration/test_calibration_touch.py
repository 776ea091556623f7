"""The map to the plane from touched points seen in rendered images."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from calibration.lens import Lens
from calibration.pointer import find_pointer
from calibration.touched_points import TouchedPoints, TouchSettings, TouchVerdict
from drivers.errors import ConfigurationError
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from drivers.types import Array, Frame, Pose, frozen
from tests.support.twin_calibration import NO_STRIP, pointer_frame, twin_calibration

CAMERA = CameraSettings()


@lru_cache
def _renderer() -> Renderer:
    return Renderer(CAMERA, NO_STRIP, 0)


@lru_cache
def _lens() -> Lens:
    """The true lens, so that these tests fail for the plane alone."""
    optics = Optics.of(CAMERA)
    matrix = [[optics.focal, 0, optics.principal[0]], [0, optics.focal, optics.principal[1]]]
    return Lens(1280, 720, frozen([*matrix, [0, 0, 1]]), frozen([*optics.distortion, 0, 0, 0]))


def _touched(loose: dict[int, Array] | None = None) -> TouchVerdict:
    """All points touched; those in `loose` seen away from where the arm says."""
    touched = TouchedPoints(_lens(), TouchSettings())
    point, sequence = 0, 0
    while (pose := touched.ask()) is not None:
        off = (loose or {}).get(point, np.zeros(2))
        seen = replace(pose, x=pose.x + off[0], z=pose.z + off[1])
        while touched.tell(pointer_frame(_renderer(), seen, sequence), pose) is not None:
            sequence += 1
        point, sequence = point + 1, sequence + 1
    return touched.verdict()


def test_pointer_is_found_within_a_tenth_of_a_pixel() -> None:
    optics = Optics.of(CAMERA)
    for k, (x, z) in enumerate([(0.05, 0.02), (0.3, 0.15), (0.58, 0.29)]):
        centre = find_pointer(pointer_frame(_renderer(), Pose(x, z, np.pi / 2), k).image)
        assert centre is not None
        assert np.hypot(*(centre - optics.plane(np.array([x, z])))) < 0.1


@pytest.mark.parametrize("level", [0, 255])
def test_no_pointer_in_a_blank_image(level: int) -> None:
    assert find_pointer(np.full((720, 1280, 3), level, np.uint8)) is None


def test_two_discs_are_not_a_pointer() -> None:
    one = pointer_frame(_renderer(), Pose(0.2, 0.2, np.pi / 2), 0).image
    other = pointer_frame(_renderer(), Pose(0.5, 0.2, np.pi / 2), 0).image
    both = one.copy()
    both[:, 640:] = other[:, 640:]
    assert find_pointer(both) is None


def test_touched_points_give_the_plane_to_a_tenth_of_a_millimetre() -> None:
    verdict = _touched()
    assert verdict.passed, verdict.reasons
    assert verdict.used >= 12
    assert verdict.held_out >= 3
    assert verdict.residual_mm < 0.1
    assert verdict.homography is not None
    grid = np.array([(x, z) for x in np.linspace(0, 0.6, 9) for z in np.linspace(0, 0.33, 6)])
    seen = verdict.homography.to_plane(_lens().undistort(Optics.of(CAMERA).plane(grid)))
    assert np.hypot(*(seen - grid).T).max() < 1e-4


def test_whole_calibration_through_images_knows_where_the_camera_stands() -> None:
    calibration = twin_calibration(CAMERA)
    assert calibration.residual_mm < 0.1
    centre = Optics.of(CAMERA).centre
    assert np.abs(calibration.viewpoint.foot() - centre[[0, 2]]).max() < 0.015
    assert calibration.viewpoint.distance == pytest.approx(-centre[1], rel=0.01)


def test_slipped_pointer_is_named_and_does_not_move_the_plane() -> None:
    verdict = _touched({5: np.array([0.004, 0.003])})
    assert [rejected.index for rejected in verdict.rejected] == [4]
    assert verdict.homography is not None
    assert verdict.residual_mm < 0.1


def test_slipped_pointer_at_a_held_out_point_refuses_the_verdict() -> None:
    verdict = _touched({6: np.array([0.004, 0.003])})
    assert not verdict.passed
    assert verdict.worst_mm == pytest.approx(5.0, abs=0.2)
    assert "check that the pointer is tight" in verdict.reasons[0]


def test_moving_pointer_is_not_sampled() -> None:
    touched = TouchedPoints(_lens(), TouchSettings(patience=4))
    wanted = touched.ask()
    assert wanted is not None
    answers = []
    for k in range(3):
        pose = replace(wanted, x=wanted.x + 0.002 * k)
        answers.append(touched.tell(pointer_frame(_renderer(), pose, k), pose))
    assert answers[0] is not None
    assert "still" in answers[0]
    assert all(answer is not None and "moved by 3." in answer for answer in answers[1:])
    assert touched.ask() == wanted


def test_unseen_pointer_is_given_up_after_patience_and_too_few_points_refused() -> None:
    touched = TouchedPoints(_lens(), TouchSettings(patience=2))
    blank = Frame(0.0, 0.0, "test", 0, np.zeros((720, 1280, 3), np.uint8))
    asked = 0
    while (pose := touched.ask()) is not None:
        assert "disc is not seen" in str(touched.tell(blank, pose))
        asked += 1
    assert asked == 2 * 20
    verdict = touched.verdict()
    assert not verdict.passed
    assert "0 touched points, at least 12" in verdict.reasons[0]


def test_plan_with_too_few_points_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="at least 12 are fitted"):
        TouchedPoints(_lens(), TouchSettings(columns=4, rows=3))
