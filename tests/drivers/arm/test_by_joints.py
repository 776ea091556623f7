"""Poses sent as joints: the elbow stays, every limit is kept, lost commands are taken up."""

import numpy as np
import pytest

from drivers.arm.by_joints import ByJoints
from drivers.arm.failure import Failed
from drivers.arm.messages import Kind
from drivers.types import Pose
from tests.drivers.arm.lossy_robot import LossyRobot
from tests.drivers.arm.test_loop import JOINTS, begun_with
from tests.drivers.arm.test_lost_ticks import LOSSES, long_enough


def wandered(robot: object, inner: LossyRobot) -> float:
    """How far [rad] the elbow gets on 600 ms of a way up and back."""
    setup = begun_with(robot)
    setup.order(Kind.MOVE, 0.35, 0.3, 1.2)
    setup.steps(600)
    return abs(float(inner.robot.posture.q[2]) - JOINTS[2])


def test_elbow_stays_where_the_motion_began() -> None:
    inner = LossyRobot(JOINTS, 1, 1, share=0.0)
    inner.robot.chooses_elbow = True
    assert wandered(ByJoints(inner), inner) < 1e-6
    assert not inner.robot.errors


def test_without_an_elbow_the_robot_s_own_inverse_lets_it_wander() -> None:
    inner = LossyRobot(JOINTS, 1, 1, share=0.0)
    inner.robot.chooses_elbow = True
    assert wandered(inner, inner) > 0.2  # into a reflex, a moment later


@pytest.mark.slow
@pytest.mark.parametrize("own_clock", [False, True])
@pytest.mark.parametrize(("worst", "share"), LOSSES)
def test_lost_commands_stop_no_motion_move_no_goal_and_no_elbow(
    worst: int, share: float, own_clock: bool
) -> None:
    robot = LossyRobot(JOINTS, worst, worst, share)
    setup = begun_with(ByJoints(robot, own_clock=own_clock))
    elbow, goal = float(robot.robot.posture.q[2]), Pose(0.45, 0.25, 0.6)
    setup.order(Kind.MOVE, goal.x, goal.z, goal.pitch)
    setup.steps(300)
    setup.order(Kind.FOLLOW, 0.1, 0.0, -0.3)
    setup.steps(60)
    setup.order(Kind.MOVE, goal.x, goal.z, goal.pitch)
    report = setup.steps((1 + own_clock) * long_enough(share))
    assert robot.lost > 100
    assert not robot.robot.errors
    assert (report.x, report.z, report.pitch) == pytest.approx(
        (goal.x, goal.z, goal.pitch), abs=1e-4
    )
    assert float(robot.robot.posture.q[2]) == pytest.approx(elbow, abs=1e-3)
    setup.loop.end()
    assert robot.ended
    assert not robot.robot.errors


@pytest.mark.parametrize("seed", range(2))
def test_full_speed_reversals_stay_within_the_joints_limits(seed: int) -> None:
    from tests.drivers.arm.test_guard import FOLLOWED, HIGHEST

    inner, rng = LossyRobot(JOINTS, seed, 1, share=0.0), np.random.default_rng(5000 + seed)
    setup = begun_with(ByJoints(inner))
    for _ in range(16):
        setup.order(Kind.FOLLOW, *(rng.choice(FOLLOWED, 3) * HIGHEST))
        setup.steps(int(rng.integers(10, 95)))
        if setup.loop.halted is not None:
            break
    assert not inner.robot.errors


def test_a_pose_before_the_first_state_is_refused() -> None:
    inner = LossyRobot(JOINTS, 1, 1, share=0.0)
    driven = ByJoints(inner)
    with pytest.raises(Failed, match="before the first state"):
        driven.write_pose(driven.start_poses(), [0.0] * 16)


@pytest.mark.parametrize("further", [False, True])
def test_an_answer_made_for_a_tick_is_sent_in_that_tick_only(monkeypatch, further: bool) -> None:
    inner, written = LossyRobot(JOINTS, 1, 1, share=0.0), []
    driven = ByJoints(inner, own_clock=True)
    setup = begun_with(driven)
    setup.order(Kind.FOLLOW, -0.1, 0.05, 0.0)
    setup.steps(80)
    after_a_loss = driven.read(None)
    if further:
        inner.robot.miss()
        inner.robot.time += 1
    monkeypatch.setattr(inner, "write_joints", lambda *given, **_: written.append(given))
    driven.write_pose(None, after_a_loss.O_T_EE_c)
    assert bool(written) is not further
