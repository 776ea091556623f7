"""The guard of the joints: whatever the cell asks for, the robot never has to stop the
arm.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike

from drivers.base.types import Pose, Velocity
from drivers.franka import limits
from drivers.franka.limits import FR3
from drivers.franka.mailbox import CommandKind
from drivers.franka.reach import PredictedMotion, Reach, plan_reach
from tests.drivers.franka.rig import (
    INSTALLATION,
    JOINTS,
    START,
    LossyRobot,
    begun,
    reach_guard,
)

FOLLOWED = np.array([-1.0, -1.0, 0.0, 0.5, 1.0])  # of the highest velocity of an axis
HIGHEST = np.array([axis.velocity for axis in INSTALLATION.limits.axes])
STILL = Velocity(0.0, 0.0, 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_full_speed_reversals_at_any_place_stay_within_the_joints_limits(
    seed: int,
) -> None:
    robot, rng = (
        LossyRobot(JOINTS, seed, 1, share=0.0),
        np.random.default_rng(5000 + seed),
    )
    setup = begun(robot)
    fastest = 0.0
    for _ in range(16):
        if rng.random() < 0.3:
            place = rng.uniform((-0.1, 0.0, -0.1), (0.8, 0.45, 3.2))
            setup.order(CommandKind.MOVE, *place)
        else:
            setup.order(CommandKind.FOLLOW, *(rng.choice(FOLLOWED, 3) * HIGHEST))
        for _ in range(int(rng.integers(10, 95))):
            setup.steps(1)
            joints = robot.posture.joints
            share = np.abs(joints.acceleration) / limits.ACCELERATION
            fastest = max(fastest, float(share.max()))
        if setup.loop.halted is not None:
            break
    assert not robot.errors
    assert 0.3 < fastest < 1.0


def test_guard_objects_to_what_braking_could_not_stop() -> None:
    guard = reach_guard()
    calm = PredictedMotion(Pose(*START), STILL, STILL)
    assert guard.objection(calm) == ""
    fast = calm._replace(velocity=Velocity(0.0, 0.0, 20.0))
    assert "could not follow" in guard.objection(fast) or "end" in guard.objection(fast)
    hasty = calm._replace(acceleration=Velocity(0.0, 0.0, 40.0))
    guard = reach_guard()
    assert "could not follow" in guard.objection(hasty)


def test_guard_objects_to_joints_that_turn_too_fast_here() -> None:
    slow = PredictedMotion(Pose(*START), Velocity(0.02, 0.0, 0.0), STILL)
    assert reach_guard().objection(slow) == ""
    few = replace(FR3, velocity=(1e-3,) * 7)
    guard = reach_guard(few)
    assert "could not follow" in guard.objection(slow)


def planned(path: ArrayLike, speed: float) -> Reach:
    """How the arm follows a `path` (n, 3) at one `speed` [m/s], joint 3 at 0."""
    return plan_reach(
        INSTALLATION, np.array(path), np.full(len(path), speed), elbows=(0.0,)
    )


def test_path_through_a_singular_posture_is_refused_before_the_motion() -> None:
    z = np.arange(0.62, 0.64, 0.0005)
    path = np.column_stack([np.full(len(z), 0.3), z, np.full(len(z), np.pi / 2)])
    reach = planned(path, 1e-4)
    assert "stretched or folded" in reach.problems[0].reason
    assert 0.63 < reach.problems[0].z < 0.64


def test_margin_of_a_path_is_that_of_its_worst_place() -> None:
    far = (0.65, 0.15, 0.0)
    whole = planned([far, START], 0.1)
    assert whole.margin == pytest.approx(planned([far], 0.1).margin)


def test_guard_objects_beyond_the_arm_s_reach() -> None:
    guard = reach_guard()
    x, z, pitch = START
    objections = [
        guard.objection(PredictedMotion(Pose(x + 0.01 * step, z, pitch), STILL, STILL))
        for step in range(60)
    ]
    assert objections[0] == ""
    assert any(objections)
