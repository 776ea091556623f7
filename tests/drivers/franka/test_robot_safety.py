"""What protects people and robot is set, read and obeyed: thresholds, guards,
scheduler, forces.
"""

import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

import drivers.franka.robot
from drivers.base.errors import Fault
from drivers.base.geometry import CellInRobot
from drivers.base.installation import AxisLimits, Installation, MotionLimits
from drivers.base.types import Pose, Velocity
from drivers.franka import joint_requests as requests
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.force import ForceGuard
from drivers.franka.inverse_kinematics import solve
from drivers.franka.joint_motion import follow_joints
from drivers.franka.joint_requests import GoTo, go_to
from drivers.franka.kinematics import forward
from drivers.franka.limits import FR3
from drivers.franka.mailbox import CommandKind
from drivers.franka.plane import StripPlane
from drivers.franka.process import RobotAccess
from drivers.franka.reach import PredictedMotion
from drivers.franka.robot import Robot
from drivers.franka.settings import FciSettings
from drivers.twin.clock import TwinClock
from drivers.twin.fci_server.faults import ContactFault
from drivers.twin.fci_server.server import RobotServer
from drivers.twin.fci_server.wire import RobotMode
from tests.drivers.franka.rig import (
    COLLISION,
    INSTALLATION,
    JOINTS,
    PLANE,
    START,
    LossyRobot,
    arm_of,
    begun,
    near,
    reach_guard,
    served,
    task,
)
from tests.support.children import children

HERE, STILL = Pose(*START), Velocity(0.0, 0.0, 0.0)


def assert_collision_thresholds(server: RobotServer) -> None:
    """Those of the settings, each quantity at its own, in every phase of a motion."""
    found, wanted = server.robot.configuration.thresholds, COLLISION
    torque = [[wanted.torque_lower] * 7, [wanted.torque_upper] * 7]
    lower = [wanted.force_lower] * 3 + [wanted.moment_lower] * 3
    upper = [wanted.force_upper] * 3 + [wanted.moment_upper] * 3
    for rows in (found.torque_accelerating, found.torque_nominal):
        assert rows.tolist() == torque
    for rows in (found.force_accelerating, found.force_nominal):
        assert rows.tolist() == [lower, upper]


def test_collision_thresholds_are_set_before_the_plane_s_motion() -> None:
    with served() as server, closing(arm_of(server)) as arm:
        arm.connect()
        assert_collision_thresholds(server)


def test_collision_thresholds_are_set_before_the_way_home() -> None:
    with served() as server:
        go_to(task(server), GoTo(near(), 1.0))
        assert_collision_thresholds(server)


def test_guard_stops_the_way_home() -> None:
    push = ContactFault(kind="contact", at=60, force=(0.0, 0.0, 20.0))
    with served(faults=[push]) as server:
        with pytest.raises(Fault, match=r"20\.0 N, allowed 15\.0 N") as fault:
            go_to(task(server), GoTo(near(0.3), 1.0))
        assert fault.value.name == "arm_contact"
        assert server.robot.posture.q[0] < near(0.2)[0]
        assert server.robot.posture.at_rest
        # commanded to stand, not dropped in motion
        assert server.robot.mode is RobotMode.IDLE


@pytest.mark.parametrize(("rate", "tares"), [(0.002, 3), (0.05, 1)])
def test_force_is_tared_at_rest_in_each_posture_of_the_way_home(
    monkeypatch, rate, tares
) -> None:
    taken: list[float] = []

    class Still(LossyRobot):
        def __init__(self, *_: object) -> None:
            super().__init__(JOINTS)
            self.require_ready = self.require_tool = lambda: None
            self.configure = lambda _: None

        def state(self) -> SimpleNamespace:
            found = self.read(None)
            found.dq = [0.0] * 6 + [-rate]
            return found

        def tared_guard(self) -> ForceGuard:
            taken.append(self.state().q[0])
            return ForceGuard(20.0)

    way = [np.array(near(0.02)), np.array(near(0.04))]
    monkeypatch.setattr("drivers.franka.robot.Robot", Still)
    monkeypatch.setattr(requests, "clear_path", lambda *_: way)
    monkeypatch.setattr("drivers.franka.process.apply_realtime", lambda _: None)
    monkeypatch.setattr(
        requests, "TerminationFlag", lambda: SimpleNamespace(is_set=False, check=bool)
    )
    request = GoTo(near(0.04), 1.0)
    given = RobotAccess("", FciSettings(), INSTALLATION)
    pipe = SimpleNamespace(poll=lambda: False, send=lambda _: None)
    requests.carry_out(pipe, given, request)
    assert taken == pytest.approx(
        [JOINTS[0], JOINTS[0], near(0.02)[0]][:tares], abs=1e-4
    )


def test_reported_force_points_as_the_cell_s_axes_do() -> None:
    plane = StripPlane(CellInRobot.from_yaw(0.3, 0.1, 0.0, np.pi / 2))
    along_x_of_the_cell, up = [0.0, 3.0, 0.0, 0, 0, 0], [0.0, 0.0, 5.0, 0, 0, 0]
    assert plane.force(along_x_of_the_cell) == pytest.approx((3.0, 0.0))
    assert plane.force(up) == pytest.approx((0.0, 5.0))


@pytest.mark.parametrize(
    ("speed", "found"), [(-0.2, "joint 2 comes to its end"), (0.2, "")]
)
def test_guard_looks_where_a_braking_arm_comes_to_rest(
    speed: float, found: str
) -> None:
    guard = reach_guard()
    x, z, pitch = START
    while z > -0.205:  # 15 mm above where joint 2 is at its end; braking takes 25 mm
        assert guard.objection(PredictedMotion(Pose(x, z, pitch), STILL, STILL)) == ""
        z -= 0.005
    assert (
        guard.objection(
            PredictedMotion(Pose(x, z, pitch), Velocity(0.0, speed, 0.0), STILL)
        )
        == found
    )


@pytest.mark.parametrize(
    ("realtime", "restored"), [("ignore", 1), ("priority", 1), ("enforce", 0)]
)
def test_library_s_scheduling_stays_only_where_it_is_enforced(
    monkeypatch, realtime: str, restored: int
) -> None:
    modes, calls = [], []
    library = SimpleNamespace(
        Robot=lambda _, mode: modes.append(mode),
        RealtimeConfig=drivers.franka.robot.franka.RealtimeConfig,
    )
    monkeypatch.setattr(drivers.franka.robot, "franka", library)
    monkeypatch.setattr(os, "sched_setscheduler", lambda *given: calls.append(given))
    address = "127.254.254.1"
    Robot(address, FciSettings(address=address, realtime=realtime), FR3)
    assert len(calls) == restored
    assert modes == [
        library.RealtimeConfig.kEnforce
        if realtime == "enforce"
        else library.RealtimeConfig.kIgnore
    ]


def test_pressed_user_stop_is_named_and_nothing_moves() -> None:
    with served() as server:
        server.robot.press_user_stop()
        with pytest.raises(Fault) as fault:
            go_to(task(server), GoTo(near(), 1.0))
        assert fault.value.name == "arm_user_stop"
        assert server.robot.ticks == 0


def misread(change: Callable[[list[float]], list[float]]) -> ArmFault | None:
    """Why an arm in motion halts, if it does, whose joints read as `change` says."""
    setup = begun()
    setup.order(CommandKind.FOLLOW, -0.1, 0.0, 0.0)
    setup.steps(50)
    read = setup.robot.read

    def changed(motion):
        state = read(motion)
        state.q = change(state.q)
        return state

    setup.robot.read = changed
    setup.steps(300)
    return setup.loop.halted


def test_pose_that_is_not_a_number_stops_the_arm() -> None:
    assert misread(lambda _: [float("nan")] * 7).cause is Cause.NOT_FINITE


def test_arm_brakes_before_it_comes_where_it_could_not_follow() -> None:
    setup = begun()
    setup.order(CommandKind.MOVE, 0.84, START[1], START[2])
    report = setup.steps(3000)
    assert setup.loop.halted.cause is Cause.REACH
    assert report.x < 0.75


def test_speed_of_the_robot_bounds_that_of_the_cell() -> None:
    found = FciSettings().limit(Installation(limits=MotionLimits()))
    assert found.limits.pitch.acceleration == FciSettings().limits.pitch.acceleration
    slow = MotionLimits(x=AxisLimits(velocity=0.01, acceleration=0.1, jerk=1.0))
    assert FciSettings().limit(Installation(limits=slow)).limits.x == slow.x


def test_share_of_the_speed_bounds_every_joint_on_the_way_home() -> None:
    robot, rates = LossyRobot(JOINTS), []
    written = robot.write_joints

    def noted(*given, **named) -> None:
        written(*given, **named)
        rates.append(np.abs(robot.posture.joints.velocity).max())

    robot.write_joints = noted
    follow_joints(robot, near(0.02), 0.1, ForceGuard(20.0), lambda _: False)
    assert 0.045 < max(rates) < 0.051  # a tenth of 0.5 rad/s


def test_arm_that_is_only_held_for_its_camera_is_commanded_by_nobody() -> None:
    with served() as server, closing(arm_of(server)) as arm:
        arm.hold()
        for command in (
            arm.state,
            lambda: arm.move_to(HERE),
            lambda: arm.set_velocity(STILL),
        ):
            with pytest.raises(Fault, match="connect it first"):
                command()
        arm.stop()
        assert arm._commands.count == 0


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, signal.SIGHUP], ids=["terminate", "hang up"]
)
def test_signal_to_all_processes_brakes_the_arm_and_does_not_drop_it(
    number: int,
) -> None:
    """A closed terminal or a shutdown sends it to the process of the arm, too."""
    clock = TwinClock()
    with served() as server, closing(arm_of(server, clock)) as arm:
        arm.connect()
        for until in range(10, 210, 10):
            arm.set_velocity(Velocity(-0.1, 0.0, 0.0))
            clock.wait_until(1e-3 * until)
        assert arm.state().velocity.vx < -0.05
        os.kill(*children("run_loop"), number)
        for until in (220, 230):
            clock.wait_until(1e-3 * until)
            with pytest.raises(Fault) as fault:
                arm.state()
            assert fault.value.name == Cause.ENDED
        assert abs(arm._reports.read().vx) < 1e-2
        assert server.robot.posture.at_rest
        assert server.robot.mode is RobotMode.IDLE


def test_way_home_that_was_asked_to_end_says_that_it_did_not_arrive() -> None:
    with served() as server, ThreadPoolExecutor(1) as beside:
        gone = beside.submit(go_to, task(server), GoTo(near(0.3), 0.2))
        deadline = time.monotonic() + 60.0
        while server.robot.ticks < 100 and time.monotonic() < deadline:
            time.sleep(0.005)
        for pid in children("carry_out"):
            os.kill(pid, signal.SIGTERM)
        assert isinstance(fault := gone.exception(60.0), Fault)
        assert fault.name == Cause.ENDED
        assert server.robot.posture.at_rest


@pytest.mark.parametrize(
    ("aside", "halts"), [(0.01, False), (0.03, True), (-0.03, True)]
)
def test_arm_that_is_pushed_out_of_the_strip_s_plane_brakes(
    aside: float, halts: bool
) -> None:
    """Along the plane the cell's monitor of tracking sees it, across it nobody else
    does.
    """

    def pushed(joints: list[float]) -> list[float]:
        pose = forward(np.array(joints))
        pose[:3, 3] += aside * PLANE.matrix[:3, 1]
        return solve(pose, np.array(joints)).tolist()

    halted = misread(pushed)
    assert (halted is not None) is halts
    if halted is not None:
        assert halted.cause is Cause.ASIDE
        assert "30 mm beside" in halted.words


def test_motion_tells_how_much_of_its_way_is_done() -> None:
    told = list[float]()
    with served() as server:
        go_to(task(server), GoTo(near(0.2), 0.2), told.append)
    assert len(told) > 5
    assert told == sorted(told)
    assert told[0] < 0.1
    assert told[-1] > 0.8
