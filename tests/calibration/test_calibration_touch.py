"""The map to the plane from touched points seen in rendered images."""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest

from calibration.board import find_pointer
from calibration.wizard.progress import SessionRow
from calibration.wizard.touch_verdict import TouchVerdict
from calibration.wizard.touched_points import TouchedPoints
from calibration.wizard.touches import TouchSettings
from drivers.base.errors import ConfigurationError
from drivers.base.types import Array, Frame, Pose
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.twin_calibration import NO_STRIP, pointer_frame, true_lens

CAMERA = CameraSettings()


@lru_cache
def _renderer() -> Renderer:
    return Renderer(CAMERA, NO_STRIP, 0)


Loose = dict[int, Array]


def _touched(
    loose: Loose | None = None, loose_again: Loose | None = None
) -> TouchVerdict:
    """All points touched; those in `loose` seen away from where the arm says, at first
    or again.
    """
    touched, sequence = TouchedPoints(true_lens(), TouchSettings()), 0
    while (pose := touched.ask()) is not None:
        number = touched.number
        assert number is not None
        off = ((loose_again if touched.again else loose) or {}).get(number, np.zeros(2))
        seen = replace(pose, x=pose.x + off[0], z=pose.z + off[1])
        touched.tell(pointer_frame(_renderer(), seen, sequence), pose)
        sequence += 1
    return touched.verdict()


def test_pointer_is_found_within_a_tenth_of_a_pixel() -> None:
    optics = Optics.from_settings(CAMERA)
    for k, (x, z) in enumerate([(0.05, 0.02), (0.3, 0.15), (0.58, 0.29)]):
        centre = find_pointer(
            pointer_frame(_renderer(), Pose(x, z, np.pi / 2), k).image
        )
        assert centre is not None
        assert np.hypot(*(centre - optics.plane(np.array([x, z])))) < 0.1
    for radius in (4, 28):
        image = cv2.circle(
            np.zeros((200, 200, 3), np.uint8), (90, 110), radius, (255,) * 3, -1
        )
        assert find_pointer(image) == pytest.approx((90, 110), abs=0.1)


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
    grid = np.array(
        [(x, z) for x in np.linspace(0, 0.6, 9) for z in np.linspace(0, 0.33, 6)]
    )
    pixels = true_lens().undistort(Optics.from_settings(CAMERA).plane(grid))
    seen = verdict.plane_map.homography.to_plane(pixels)
    assert np.hypot(*(seen - grid).T).max() < 1e-4


SLIP = np.array([0.004, 0.003])


def test_slipped_touch_is_repeated_and_named() -> None:
    verdict = _touched({5: SLIP, 6: 3 * SLIP})
    assert verdict.passed
    assert verdict.clean
    assert list(verdict.wild) == [5, 6]
    assert "point 5 at x 0.600, z 0.015 m is 8.5 px off" in verdict.wild[5]
    assert verdict.used + verdict.held_out == 24
    assert verdict.worst_mm < 0.1


@pytest.mark.parametrize(("number", "held_out"), [(5, 6), (6, 5)])
def test_point_that_is_wild_twice_is_left_out_and_does_not_decide(
    number, held_out
) -> None:
    verdict = _touched({number: SLIP}, {number: -2 * SLIP})
    assert verdict.passed
    assert not verdict.clean
    assert (list(verdict.rejected), verdict.held_out) == ([number], held_out)
    assert verdict.residual_mm < 0.1


def test_held_out_point_off_in_the_same_way_twice_refuses_the_verdict() -> None:
    verdict = _touched({6: SLIP}, {6: SLIP})
    assert not verdict.passed
    assert verdict.worst_mm == pytest.approx(5.0, abs=0.2)
    assert "check that the pointer is tight" in verdict.reasons[0]
    assert any(
        "points 6 are off in the same way when touched again" in r
        for r in verdict.reasons
    )


def test_pointer_that_slips_at_every_third_touch_is_refused() -> None:
    verdict = _touched({k: (1 + k % 4) * SLIP for k in range(0, 24, 3)})
    assert not verdict.passed
    assert any(
        "8 of 24 first touches were wild; the pointer is loose" in r
        for r in verdict.reasons
    )


@pytest.mark.parametrize(
    ("pointer", "arm", "reason"),
    [
        (0.002, 0.0, "the pointer moved by 3."),
        (
            0.0,
            0.001,
            "the arm moved by 1.0 mm between two images; wait until it is still",
        ),
    ],
)
def test_what_moves_is_not_sampled(pointer: float, arm: float, reason: str) -> None:
    points = TouchedPoints(true_lens(), TouchSettings(patience=4))
    wanted, told = points.ask(), []
    for k in range(3):
        seen = pointer_frame(_renderer(), replace(wanted, x=wanted.x + pointer * k), k)
        told.append(points.tell(seen, replace(wanted, x=wanted.x + arm * k)))
    assert told[0].waits
    assert not any(answer.taken for answer in told)
    assert all(reason in str(answer.refused) for answer in told[1:])
    assert points.ask() == wanted


def test_unseen_pointer_is_given_up_after_patience_and_too_few_points_refused() -> None:
    touched = TouchedPoints(true_lens(), TouchSettings(patience=2))
    blank = Frame(0.0, 0.0, "test", 0, np.zeros((720, 1280, 3), np.uint8))
    asked = 0
    while (pose := touched.ask()) is not None:
        assert "disc is not seen" in str(touched.tell(blank, pose).refused)
        asked += 1
    assert asked == 2 * 24
    verdict = touched.verdict()
    assert not verdict.passed
    assert "0 touched points, at least 12" in verdict.reasons[0]


def test_image_of_another_size_than_the_lens_is_refused() -> None:
    touched = TouchedPoints(true_lens(), TouchSettings())
    turned = Frame(0.0, 0.0, "test", 0, np.zeros((1280, 720, 3), np.uint8))
    with pytest.raises(
        ConfigurationError, match="720 x 1280 px, the lens was found with 1280 x"
    ):
        touched.tell(turned, Pose(0.0, 0.0, 0.0))


def test_point_can_be_touched_again_on_request() -> None:
    touched = TouchedPoints(true_lens(), TouchSettings())
    first = touched.ask()
    assert first is not None
    for k in range(2):
        touched.tell(pointer_frame(_renderer(), first, k), first)
    assert touched.number == 1
    assert touched.take_back() == SessionRow(number=0, dropped=True)
    assert touched.ask() == first
    assert touched.touches == ()


def test_own_poses_are_touched_instead_of_the_grid() -> None:
    plan = [Pose(0.05 * k, 0.02 + 0.07 * (k % 4), np.pi / 2) for k in range(16)]
    touched = TouchedPoints(true_lens(), TouchSettings(), plan)
    assert touched.ask() == plan[0]
    with pytest.raises(
        ConfigurationError, match="10 points with every 4th held out leave 8"
    ):
        TouchedPoints(true_lens(), TouchSettings(), plan[:10])
    with pytest.raises(ConfigurationError, match="at least 12 are fitted"):
        TouchedPoints(true_lens(), TouchSettings(columns=4, rows=3))
