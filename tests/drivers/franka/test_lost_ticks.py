"""The 1 kHz loops on a network that loses commands: the robot goes on by itself
meanwhile.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from drivers.base.motion import TICK
from drivers.franka.failure import ArmFault
from drivers.franka.force import ForceGuard
from drivers.franka.inverse_kinematics import solve
from drivers.franka.joint_motion import follow_joints
from drivers.franka.kinematics import HOME
from drivers.franka.mailbox import CommandKind
from drivers.franka.plane import StripPlane
from tests.drivers.franka.rig import (
    JOINTS,
    PLANE,
    START,
    LossyRobot,
    begun,
)

LOSSES = [(1, 0.1), (8, 0.1), (15, 0.1), (1, 0.5)]  # worst in a row, share of commands


@pytest.mark.slow
@pytest.mark.parametrize(("worst", "share"), LOSSES)
@pytest.mark.parametrize("lock_step", [False, True])
def test_lost_commands_stop_no_motion_move_no_goal_and_no_elbow(
    worst: int, share: float, lock_step: bool
) -> None:
    # where half is lost, the arm is kept about its goal; it gets there once commands
    # arrive again
    ticks, received = (1000, 0) if share < 0.5 else (1500, 400)
    ticks *= 2 - lock_step
    robot = LossyRobot(JOINTS, worst if share < 0.5 else 2, worst, share)
    setup = begun(robot, lock_step=lock_step)
    elbow, goal = float(robot.posture.q[2]), (0.45, 0.25, 0.6)
    setup.order(CommandKind.MOVE, *goal)
    setup.steps(300)
    setup.order(CommandKind.FOLLOW, 0.1, 0.0, -0.3)
    setup.steps(60)
    setup.order(CommandKind.MOVE, *goal)
    setup.steps(ticks)
    robot.share = 0.0 if received else share
    report = setup.steps(received)
    robot.share = share
    assert robot.lost > 100
    assert (report.x, report.z, report.pitch) == pytest.approx(goal, abs=1e-4)
    assert float(robot.posture.q[2]) == pytest.approx(elbow, abs=1e-6)
    setup.loop.end()
    assert robot.ended
    assert not robot.errors


def test_corrections_at_rest_before_the_cell_s_first_sign_are_no_failure() -> None:
    setup = begun(LossyRobot(JOINTS, 1, 1, 0.5))
    for _ in range(1500):
        setup.loop.step()
    assert setup.loop.halted is None


@pytest.mark.parametrize(("worst", "share"), LOSSES[1:])
def test_velocity_targets_are_followed_and_braked_while_commands_are_lost(
    worst: int, share: float
) -> None:
    robot = LossyRobot(JOINTS, 7, worst, share)
    setup = begun(robot)
    for vx, vz, turn in ((-0.1, 0.1, 1.2), (-0.15, 0.0, 0.3), (0.0, 0.1, -0.5)):
        setup.order(CommandKind.FOLLOW, vx, vz, turn)
        setup.steps(50)
    setup.loop.end()
    assert robot.ended
    assert not robot.errors


@pytest.mark.parametrize("holds", [False, True])
def test_hand_keeps_its_speed_though_a_quarter_of_the_commands_is_lost(
    holds: bool,
) -> None:
    robot = LossyRobot(JOINTS, 3, 1, 0.25, holds=holds)
    setup = begun(robot)
    ticks, places = [], []
    for _ in range(50):
        setup.order(CommandKind.FOLLOW, -0.1, 0.0, 0.0)
        places.append(setup.steps(10).x)
        ticks.append(robot.time)
    speed = np.polyfit(np.array(ticks[10:]) * TICK, places[10:], 1)[0]
    assert speed == pytest.approx(-0.1, rel=0.05)


@pytest.mark.parametrize(("worst", "share"), [(8, 0.1), (1, 0.5)])
def test_one_who_leaves_on_the_way_home_finds_the_robot_at_rest(
    worst: int, share: float
) -> None:
    robot = LossyRobot(HOME, 3, worst, share)
    follow_joints(
        robot,
        (HOME + 0.2).tolist(),
        1.0,
        ForceGuard(20.0),
        lambda _: robot.time > 200,
    )
    assert robot.ended
    assert not robot.errors
    assert robot.posture.q != pytest.approx(HOME + 0.2, abs=0.05)


def test_velocity_is_measured_by_the_robot_s_time_not_by_counting_states() -> None:
    setup = begun()
    robot, plane = setup.robot, StripPlane(PLANE)
    joints = np.array(JOINTS)
    for skipped in (0, 3, 0, 5, 0, 0, 2, 0, 9):
        robot.clock += skipped
        for _ in range(2):
            x = START[0] - 0.1 * TICK * robot.clock
            joints = solve(plane.matrix(x, *START[1:]), joints)
            robot.measured = joints.tolist()
            setup.loop._publish(robot.read(None))
    assert setup.reports.read().vx == pytest.approx(-0.1, rel=0.2)


@pytest.mark.parametrize(("worst", "share"), [(1, 0.0), *LOSSES[:3]])
@pytest.mark.parametrize("at", [100, 350, 600])
def test_contact_on_the_way_home_ends_in_a_quick_stop_that_the_cell_commands(
    worst: int, share: float, at: int
) -> None:
    robot = LossyRobot(JOINTS, 5, worst, share)
    read, met = robot.read, list[int]()

    def pressed(motion: object) -> SimpleNamespace:
        state = read(motion)
        if robot.time > at:
            met.append(robot.time)
            state.O_F_ext_hat_K = [0.0, 0.0, 30.0, 0.0, 0.0, 0.0]
        return state

    robot.read = pressed
    goal = [JOINTS[0] + 0.4, *JOINTS[1:]]
    with pytest.raises(ArmFault, match=r"met 30\.0 N, allowed 20\.0 N"):
        follow_joints(robot, goal, 1.0, ForceGuard(20.0), lambda _: False)
    assert robot.ended
    assert not robot.errors
    assert robot.time - met[0] < (100 if share == 0.0 else 400)
    assert robot.posture.q[0] < goal[0] - 0.05
