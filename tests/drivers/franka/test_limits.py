"""The published limits, number by number: a wrong one moves unseen until a joint meets
its end.
"""

import numpy as np
import pytest

from drivers.franka import limits
from drivers.franka.failure import ArmFault
from drivers.franka.limits import FR3, FR3V2, JointLimits
from drivers.franka.model import arm_urdf

# franka_description: robots/fr3/joint_limits.yaml and `position_based_velocity_limits`.
LOWER = [-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]
UPPER = [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]
FASTEST = [2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]
OFFSET = [0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35]
DECELERATION = [6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]
MIDDLE = (np.array(LOWER) + np.array(UPPER)) / 2


def test_joints_have_the_published_ranges_and_speeds() -> None:
    assert list(FR3.lower) == LOWER
    assert list(FR3.upper) == UPPER
    assert list(FR3.velocity) == FASTEST
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
    low, high = FR3.velocity_bounds(q)
    assert high[joint] == pytest.approx(min(max(most, 0.0), FASTEST[joint]))
    assert low[joint] < -high[joint]
    q[joint] = LOWER[joint] + room
    assert FR3.velocity_bounds(q)[0][joint] == pytest.approx(-high[joint])


def test_newer_revision_may_go_further_and_slows_down_by_other_offsets() -> None:
    assert FR3V2.upper == (2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508)
    assert FR3V2.offset == (0.652, 0.25, 0.2005, 0.3542, 0.5738, 0.4885, 0.4592)
    at_end = np.array(FR3.upper)
    assert FR3.velocity_bounds(at_end)[1][0] == 0.0
    assert FR3V2.velocity_bounds(at_end)[1][0] == pytest.approx(0.72, abs=0.01)


@pytest.mark.parametrize("prefix", ["", "fr3_", "fr3v2_"])
@pytest.mark.parametrize(("revision", "stated"), limits.PUBLISHED.items())
def test_limits_are_read_from_the_description_of_either_revision(
    prefix: str, revision: limits.Revision, stated: JointLimits
) -> None:
    text = arm_urdf(revision).replace('name="joint', f'name="{prefix}joint')
    finger = '<joint name="fr3_finger_joint1"/></robot>'
    assert JointLimits.from_description(text.replace("</robot>", finger)) == stated


def test_comment_in_a_description_is_no_declaration() -> None:
    assert JointLimits.from_description(arm_urdf() + "<!-- by xacro -->") == FR3


def test_another_arm_is_refused_by_its_name() -> None:
    text = arm_urdf().replace('name="joint', 'name="panda_joint')
    with pytest.raises(ArmFault, match="'panda'"):
        JointLimits.from_description(text)
    with pytest.raises(ArmFault, match="'ur5'"):
        JointLimits.from_description('<robot name="ur5"><joint name="elbow"/></robot>')


@pytest.mark.parametrize(
    "text", ["", "no xml", "<robot/>", '<!DOCTYPE a [<!ENTITY b "c">]><robot/>']
)
def test_description_that_states_no_limits_is_refused(text: str) -> None:
    with pytest.raises(ArmFault):
        JointLimits.from_description(text)


def test_joint_without_a_limit_is_refused_by_its_number() -> None:
    text = arm_urdf().replace('velocity_offset="0.3"', 'velocity_offset="nan"', 1)
    with pytest.raises(ArmFault, match=r"joint 1: .* no number velocity_offset"):
        JointLimits.from_description(text)
