"""The 1 kHz loop over a robot that goes where it is told."""

import numpy as np
import pytest

from drivers.franka.failure import ArmFault, Cause
from drivers.franka.inverse_kinematics import rotation, solve
from drivers.franka.mailbox import CommandKind
from drivers.franka.plane import StripPlane
from tests.drivers.franka.rig import (
    JOINTS,
    PLANE,
    START,
    Driven,
    FakeRobot,
    LossyRobot,
    begun,
)


@pytest.fixture
def setup() -> Driven:
    return begun()


def joints_at(pose: np.ndarray) -> list[float]:
    return solve(pose, np.array(JOINTS)).tolist()


def test_first_command_is_where_the_robot_is_commanded_itself() -> None:
    aside = StripPlane(PLANE).matrix(*START)
    aside[:3, 3] += [0.002, -0.001, 0.001]
    joints = joints_at(aside)
    setup = begun(FakeRobot(joints))
    assert setup.robot.written[0] == joints
    setup.loop.step()
    assert setup.robot.written[-1] == pytest.approx(joints, abs=1e-12)


def test_arm_out_of_the_strip_s_plane_is_not_taken_over() -> None:
    aside = StripPlane(PLANE).matrix(*START)
    aside[0, 3] += 0.02
    with pytest.raises(ArmFault, match="beside the strip's plane") as failed:
        begun(FakeRobot(joints_at(aside)))
    assert failed.value.cause is Cause.PLACE


@pytest.mark.parametrize("axis", [1, 2])
def test_hand_that_leans_out_of_the_plane_is_not_taken_over(axis: int) -> None:
    leaning = StripPlane(PLANE).matrix(*START)
    leaning[:3, :3] = leaning[:3, :3] @ rotation(0.1 * np.eye(3)[axis])
    with pytest.raises(ArmFault) as failed:
        begun(FakeRobot(joints_at(leaning)))
    assert failed.value.cause is Cause.PLACE


def test_motion_ends_only_once_the_arm_rests() -> None:
    robot = LossyRobot(JOINTS)
    setup = begun(robot)
    setup.order(CommandKind.FOLLOW, -0.1, 0.1, 0.3)
    setup.steps(60)
    assert np.linalg.norm(robot.posture.tool.velocity[:3]) > 0.05
    setup.loop.end()
    assert robot.ended
    assert not robot.errors


def test_hand_that_is_turned_is_taken_over_turned() -> None:
    turned = joints_at(StripPlane(PLANE, turned=True).matrix(*START))
    setup = begun(FakeRobot(turned))
    report = setup.steps(1)
    assert setup.robot.written[-1] == pytest.approx(turned, abs=1e-12)
    assert (report.x, report.z, report.pitch) == pytest.approx(START, abs=1e-6)


def test_loop_follows_orders_and_reports_what_it_measured(setup) -> None:
    setup.order(CommandKind.MOVE, 0.5, 0.2, 0.4)
    report = setup.steps(10)
    assert report.moving
    assert report.number == 1
    report = setup.steps(2000)
    assert not report.moving
    assert (report.x, report.z, report.pitch) == pytest.approx((0.5, 0.2, 0.4))
    assert report.ticks == 2010


def test_an_arm_that_only_turns_does_not_rest(setup) -> None:
    plane, (x, z, pitch) = StripPlane(PLANE), START
    for tick in range(10):
        setup.robot.measured = joints_at(plane.matrix(x, z, pitch + 2e-5 * tick))
        report = setup.steps(1)
    assert report.moving
    assert not setup.steps(10).moving


@pytest.mark.parametrize("lock_step", [False, True])
def test_state_is_reported_once_it_is_answered(lock_step: bool) -> None:
    setup = begun(lock_step=lock_step)
    seen: list[str] = []
    robot, loop = setup.robot, setup.loop
    for name, place in (
        ("write_joints", robot),
        ("read", robot),
        ("_publish", loop),
        ("_prepare", loop),
    ):
        act = getattr(place, name)
        setattr(place, name, told(seen, name, act))
    loop.step()
    exchange = ["write_joints", "read"] if lock_step else ["read", "write_joints"]
    assert seen == ["_prepare", *exchange, "_publish"]


def told(seen: list[str], name: str, act):
    """`act`, which also tells that it was called."""

    def acted(*given, **named):
        seen.append(name)
        return act(*given, **named)

    return acted


def test_silent_cell_makes_the_arm_brake_for_good(setup) -> None:
    setup.order(CommandKind.MOVE, 0.2, 0.2, 0.0)
    setup.steps(300)
    for _ in range(600):
        setup.loop.step()
    assert setup.loop.halted.cause is Cause.CELL_SILENT
    rest = setup.reports.read()
    setup.order(CommandKind.MOVE, 0.6, 0.2, 0.0)
    after = setup.steps(100)
    assert (after.x, after.z) == pytest.approx((rest.x, rest.z))


def test_end_brakes_to_rest_and_finishes_the_motion(setup) -> None:
    setup.order(CommandKind.MOVE, 0.2, 0.2, 0.0)
    before = setup.steps(300).x
    setup.loop.end()
    assert before - setup.reports.read().x < 0.05  # m: it does not go on to its goal
    assert setup.robot.ended
    assert setup.robot.written[-1] == pytest.approx(setup.robot.written[-2], abs=1e-9)


def test_order_that_the_profile_refuses_is_a_failure_not_a_motion(setup) -> None:
    setup.robot.written.clear()
    setup.order(CommandKind.FOLLOW, float("nan"), 0.0, 0.0)
    with pytest.raises(ArmFault) as failed:
        setup.loop.step()
    assert failed.value.cause is Cause.COMMAND
    assert setup.robot.written == []
