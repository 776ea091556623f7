"""The published limits, number by number: a wrong one moves unseen until a joint meets
its end.
"""

import numpy as np
import pytest

from drivers.franka import limits

# franka_description: robots/fr3/joint_limits.yaml and `position_based_velocity_limits`.
LOWER = [-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]
UPPER = [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]
FASTEST = [2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]
OFFSET = [0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35]
DECELERATION = [6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]
MIDDLE = (np.array(LOWER) + np.array(UPPER)) / 2


def test_joints_have_the_published_ranges_and_speeds() -> None:
    assert limits.POSITION_LOW.tolist() == LOWER
    assert limits.POSITION_HIGH.tolist() == UPPER
    assert limits.VELOCITY.tolist() == FASTEST
    assert limits.ACCELERATION.tolist() == [10.0] * 7
    assert limits.JERK.tolist() == [5000.0] * 7
    assert (limits.TRANSLATION, limits.ROTATION) == (
        (3.0, 9.0, 4500.0),
        (2.5, 17.0, 8500.0),
    )
    assert limits.ELBOW == (1.5, 10.0, 5000.0)
    assert limits.LARGEST_TORQUE.tolist() == [87.0] * 4 + [12.0] * 3


@pytest.mark.parametrize("joint", range(7))
def test_joint_near_its_end_may_move_as_fast_as_it_can_brake(joint: int) -> None:
    room, q = 0.1, MIDDLE.copy()
    q[joint] = UPPER[joint] - room
    most = np.sqrt(2 * DECELERATION[joint] * room) - OFFSET[joint]
    low, high = limits.velocity_bounds(q)
    assert high[joint] == pytest.approx(min(max(most, 0.0), FASTEST[joint]))
    assert low[joint] < -high[joint]
    q[joint] = LOWER[joint] + room
    assert limits.velocity_bounds(q)[0][joint] == pytest.approx(-high[joint])
