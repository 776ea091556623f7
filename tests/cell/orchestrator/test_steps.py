"""Commands that phases give."""

import numpy as np
import pytest

from cell.orchestrator.steps import TURNING, drive, is_at
from drivers.base.installation import Installation
from drivers.base.types import Pose
from policies.policy import Decision
from tests.support.plain_cell import GOOD, POSE, of_arm


@pytest.mark.parametrize("asked", [-9.0, -2.0, 0.0, 1.6, 2.7, 9.0])
def test_no_correction_of_the_pitch_asks_for_more_than_an_arm_gives(
    asked: float,
) -> None:
    decision = Decision(np.array([0.5]), np.array([0.1]), np.array([False]))
    rate = drive(decision, asked).velocity.pitch_rate
    assert abs(rate) <= TURNING < Installation().limits.pitch.velocity
    assert rate == asked or abs(asked) > TURNING


@pytest.mark.parametrize("axis", range(3))
def test_arm_is_at_a_pose_where_it_rests_on_every_axis_of_it(axis: int) -> None:
    rested = of_arm(moving=False)
    assert is_at(rested, POSE)
    assert not is_at(GOOD, POSE)
    for off in (0.01, -0.01):
        assert not is_at(rested, Pose(*(POSE.as_array() + off * np.eye(3)[axis])))
