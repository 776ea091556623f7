"""The body of the hand and the desk."""

import numpy as np

from drivers.arm.clearance import desk_clearance


def test_hand_that_points_down_stands_clear_of_the_desk() -> None:
    assert desk_clearance(np.array([[0.3, 0.0, np.pi / 2]]), 0.6)[0] > 0.03


def test_hand_that_lies_flat_over_the_desk_would_run_into_it() -> None:
    assert desk_clearance(np.array([[0.3, 0.0, 0.0]]), 0.6)[0] < 0


def test_hand_that_lies_flat_beside_the_desk_is_free() -> None:
    poses = np.array([[0.6, 0.0, 0.0], [0.0, 0.0, np.pi]])
    assert np.isinf(desk_clearance(poses, 0.6)).all()
