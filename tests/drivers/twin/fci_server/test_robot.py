"""The robot's own limits: whatever is commanded, the arm does not move beyond them."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from drivers.franka import limits
from drivers.franka.kinematics import HOME, forward
from drivers.franka.limits import FR3
from drivers.twin.fci_server.robot import resting_robot
from drivers.twin.fci_server.wire import (
    Generator,
    MoveRequest,
    MoveStatus,
    Reflex,
    RobotCommand,
    RobotMode,
)

TICK = 1e-3
SLACK = 1.02
JOINTS_AT, RATES, POSE, TWIST = list(Generator)[1:5]
JOINT, TOOL = "JOINT_MOTION_GENERATOR", "CARTESIAN_MOTION_GENERATOR"
OTHER_START = "MOTION_GENERATOR_START_POSE_INVALID"
STRETCHED = np.array([0.0, 0.0, 0.0, -0.5, 0.0, 0.6, 0.0])


def request(generator: Generator, controller: int = 0, **changes) -> MoveRequest:
    parts = {"deviations": (10.0,) * 6, "use_async": False} | changes
    return MoveRequest(controller, generator - 1, **parts)


def moving(generator: Generator, **changes):
    robot = resting_robot(**changes)
    assert robot.move(request(generator), 1) is MoveStatus.MOTION_STARTED
    return robot


def command(robot, q=None, dq=None, pose=None, twist=None, elbow=None, finished=False):
    return RobotCommand(
        robot.time,
        robot.posture.q if q is None else q,
        np.zeros(7) if dq is None else dq,
        robot.posture.pose if pose is None else pose,
        np.zeros(6) if twist is None else twist,
        elbow,
        finished,
    )


def shifted(pose, along=(0.0, 0.0, 0.0)):
    moved = np.array(pose)
    moved[:3, 3] += along
    return moved


def along(speed: float, axis: int = 1) -> np.ndarray:
    """Twist (6,) along, or from 3 on about, one axis."""
    return speed * np.eye(6)[axis]


def turning(speed: float) -> np.ndarray:
    """Rates (7,) of an arm of which the first joint turns."""
    return speed * np.eye(7)[0]


TIP = forward(HOME)
ASIDE = shifted(TIP, (0.001, 0, 0))


def ramped(robot, twist, ticks: int) -> None:
    """Up to a twist and on with it, until a reflex."""
    for tick in range(1, ticks + 1):
        if robot.mode is RobotMode.MOVE:
            robot.step(command(robot, twist=twist * min(1.0, tick / 200)))


@pytest.mark.parametrize(
    ("generator", "changes", "error"),
    [
        (JOINTS_AT, {"q": HOME + 0.001}, f"JOINT_POSITION_{OTHER_START}"),
        (POSE, {"pose": ASIDE}, f"CARTESIAN_POSITION_{OTHER_START}"),
        (
            POSE,
            {"pose": 1.01 * TIP},
            "CARTESIAN_POSITION_MOTION_GENERATOR_INVALID_FRAME",
        ),
        (POSE, {"elbow": (0.0, 1.0)}, f"{TOOL}_ELBOW_SIGN_INCONSISTENT"),
        (TWIST, {"twist": along(5.0)}, f"{TOOL}_VELOCITY_LIMITS_VIOLATION"),
        (TWIST, {"twist": along(4.0, 5)}, f"{TOOL}_VELOCITY_LIMITS_VIOLATION"),
        (TWIST, {"twist": along(0.1)}, f"{TOOL}_VELOCITY_DISCONTINUITY"),
        (TWIST, {"twist": along(0.006)}, f"{TOOL}_ACCELERATION_DISCONTINUITY"),
        (TWIST, {"twist": along(0.004)}, f"{TOOL}_JOINT_VELOCITY_DISCONTINUITY"),
        (TWIST, {"twist": along(0.002)}, f"{TOOL}_JOINT_ACCELERATION_DISCONTINUITY"),
        (RATES, {"dq": turning(3.0)}, f"{JOINT}_VELOCITY_LIMITS_VIOLATION"),
        (RATES, {"dq": turning(0.02)}, f"{JOINT}_VELOCITY_DISCONTINUITY"),
        (RATES, {"dq": turning(0.006)}, f"{JOINT}_ACCELERATION_DISCONTINUITY"),
    ],
)
def test_first_command_that_breaks_a_limit_ends_in_the_reflex_of_its_name(
    generator: Generator, changes: dict, error: str
) -> None:
    robot = moving(generator)
    robot.step(command(robot, **changes))
    assert robot.errors == {Reflex[error]}
    assert robot.posture.at_rest


def test_reflex_is_still_there_once_the_user_stop_is_released() -> None:
    robot = resting_robot()
    robot.reflex(Reflex.CARTESIAN_REFLEX)
    robot.press_user_stop()
    robot.release_user_stop()
    assert robot.mode is RobotMode.REFLEX
    assert robot.errors == {Reflex.CARTESIAN_REFLEX}


def test_joint_brakes_before_its_end_or_a_reflex_does() -> None:
    robot = moving(RATES)
    for tick in range(1, 4000):
        if robot.mode is RobotMode.MOVE:
            speed = 2.0 * min(1.0, tick / 400)
            robot.step(command(robot, dq=turning(speed)))
    assert robot.errors == {Reflex.JOINT_MOTION_GENERATOR_VELOCITY_LIMITS_VIOLATION}
    while not robot.posture.at_rest:
        robot.rest()
    assert robot.posture.q[0] < FR3.upper[0]


def test_tool_leaves_its_workspace_by_a_reflex(monkeypatch) -> None:
    monkeypatch.setattr("drivers.twin.fci_server.limits.TOOL_LOW", (0.0, -0.05, 0.0))
    monkeypatch.setattr("drivers.twin.fci_server.limits.TOOL_HIGH", (1.0, 0.05, 1.0))
    robot = moving(TWIST)
    ramped(robot, along(0.1), 1500)
    assert robot.errors == {Reflex.CARTESIAN_POSITION_LIMITS_VIOLATION}
    while not robot.posture.at_rest:
        robot.rest()
    assert robot.posture.reached[1, 3] < 0.053  # what it needs to brake


def test_arm_that_is_pulled_straight_stops_by_a_reflex_of_its_joints() -> None:
    robot = moving(TWIST)
    ramped(robot, along(0.3, 0), 4000)
    (error,) = robot.errors
    assert error.name.startswith("CARTESIAN_MOTION_GENERATOR_JOINT")


def test_elbow_swings_where_it_is_commanded_and_the_tool_stays() -> None:
    robot = moving(POSE)
    start = robot.posture.pose
    for tick in range(2000):
        angle = 0.05 * (1 - np.cos(np.pi * tick / 2000))
        robot.step(command(robot, pose=start, elbow=(angle, -1.0)))
    assert robot.mode is RobotMode.MOVE
    assert robot.posture.q[2] == pytest.approx(0.1, abs=1e-3)
    assert forward(robot.posture.q) == pytest.approx(start, abs=1e-6)


def test_motion_that_ends_while_it_runs_is_a_discontinuity() -> None:
    robot = moving(TWIST)
    ramped(robot, along(0.1), 300)
    robot.step(command(robot, twist=along(0.1), finished=True))
    assert robot.mode is RobotMode.REFLEX


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_command_that_is_no_number_aborts_the_motion(number: float) -> None:
    robot = moving(TWIST)
    robot.step(command(robot, twist=np.full(6, number)))
    robot.rest()
    assert robot.mode is RobotMode.IDLE
    assert [late.status for late in robot.late] == [MoveStatus.INPUT_ERROR_ABORTED]


@pytest.mark.parametrize(
    ("asked", "status"),
    [
        (request(Generator.NONE, controller=2), MoveStatus.NOT_POSSIBLE),
        (request(POSE, use_async=True), MoveStatus.NOT_POSSIBLE),
        (request(POSE, controller=7), MoveStatus.INVALID_ARGUMENT),
        (
            request(POSE, deviations=(float("nan"),) * 6),
            MoveStatus.INVALID_ARGUMENT,
        ),
    ],
)
def test_motion_that_the_twin_cannot_do_is_refused(asked: MoveRequest, status) -> None:
    assert resting_robot().move(asked, 1) is status


def test_cartesian_motion_is_refused_from_a_stretched_arm_and_a_joint_motion_is_not():
    robot = resting_robot(STRETCHED)
    assert robot.move(request(POSE), 1) is MoveStatus.SINGULAR_START
    assert robot.move(request(JOINTS_AT), 1) is MoveStatus.MOTION_STARTED


def test_robot_without_commands_goes_on_briefly_and_then_stops() -> None:
    robot = moving(TWIST)
    ramped(robot, along(0.05), 300)
    before = robot.posture.q
    for _ in range(20):
        robot.miss()
    assert robot.mode is RobotMode.MOVE
    assert robot.posture.q[0] != before[0]
    robot.miss()
    assert robot.errors == {Reflex.COMMUNICATION_CONSTRAINTS_VIOLATION}


GENERATORS = st.sampled_from(
    [
        JOINTS_AT,
        RATES,
        POSE,
        TWIST,
    ]
)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    generator=GENERATORS, seed=st.integers(0, 2**32 - 1), boldness=st.floats(0.05, 1.5)
)
def test_arm_never_moves_beyond_its_limits_whatever_is_commanded(
    generator, seed, boldness
) -> None:
    robot, random = resting_robot(), np.random.default_rng(seed)
    path, followed = [robot.posture.q], []
    twist, rate, pull = np.zeros(6), np.zeros(7), np.zeros(7)
    for tick in range(160):
        if robot.mode is RobotMode.IDLE and robot.posture.at_rest:
            twist, rate, pull = np.zeros(6), np.zeros(7), np.zeros(7)
            robot.move(request(generator), tick)
        if robot.mode is RobotMode.REFLEX:
            robot.recover(tick)
        pull = np.clip(pull + random.normal(size=7) * boldness, -8, 8)
        twist, rate = twist + pull[:6] * 3e-4, rate + pull * TICK
        pose = robot.posture.pose
        if generator is POSE:
            pose = shifted(pose, TICK * twist[:3])
        if robot.moving:
            q = robot.posture.q + TICK * rate
            robot.step(command(robot, q=q, dq=rate, pose=pose, twist=twist))
        else:
            robot.rest()
        path.append(robot.posture.q)
        followed.append(robot.moving)
    speed = np.diff(path, axis=0) / TICK
    acceleration = np.diff(speed, axis=0) / TICK
    assert (np.abs(speed) <= SLACK * np.array(FR3.velocity)).all()
    assert (np.abs(acceleration) <= SLACK * limits.ACCELERATION + 1e-6).all()
    jerk = (
        np.diff(acceleration, axis=0)[np.convolve(followed, [1, 1, 1], "valid") == 3]
        / TICK
    )
    # braking in a reflex is the robot's own
    assert (np.abs(jerk) <= SLACK * limits.JERK).all()
    assert (np.array(path) >= FR3.low).all()
    assert (np.array(path) <= FR3.high).all()
