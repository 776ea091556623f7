"""What a client may set, what is refused, and what thresholds do with a force."""

import struct

import numpy as np
import pytest

from drivers.franka.kinematics import HOME, forward
from drivers.twin.fci_server.configuration import Configuration, configure
from drivers.twin.fci_server.posture import Posture, Rates
from drivers.twin.fci_server.robot import Contact, resting_robot
from drivers.twin.fci_server.state import Publisher
from drivers.twin.fci_server.wire import (
    ClientRequest,
    Command,
    Reflex,
    RobotMode,
    Status,
)
from tests.support.fci_wire import State

UNIT = np.eye(4).T.ravel().tolist()
TURNED = [0.0, 1.0, 0.0, 0.0, -1.0, *[0.0] * 5, 1.0, 0.0, 0.01, 0.02, 0.1, 1.0]
MIRRORED = [-1.0, *UNIT[1:]]
SOLID = [0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.01]


def doubles(*numbers: float) -> bytes:
    return struct.pack(f"<{len(numbers)}d", *numbers)


def thresholds(torque: float = 20.0, force: float = 20.0, lower: float = 1.0) -> bytes:
    pair_torque, pair_force = [lower] * 7 + [torque] * 7, [lower] * 6 + [force] * 6
    return doubles(*pair_torque * 2, *pair_force * 2)


LOAD = Command.SET_LOAD
TAKEN = [
    (Command.SET_COLLISION_BEHAVIOR, thresholds()),
    (Command.SET_JOINT_IMPEDANCE, doubles(*[3000.0] * 7)),
    (Command.SET_CARTESIAN_IMPEDANCE, doubles(*[300.0] * 6)),
    (Command.SET_GUIDING_MODE, bytes((1, 0, 1, 0, 1, 0, 1))),
    (Command.SET_EE_TO_K, doubles(*TURNED)),
    (LOAD, doubles(0.5, 0.0, 0.0, 0.1, *SOLID)),
    (LOAD, doubles(3.0, 0.0, 0.0, 0.1, *SOLID)),
]
REFUSED = [
    (Command.SET_COLLISION_BEHAVIOR, thresholds(force=0.5)),
    (Command.SET_COLLISION_BEHAVIOR, thresholds(lower=-1.0)),
    (Command.SET_COLLISION_BEHAVIOR, thresholds(torque=np.nan)),
    (Command.SET_JOINT_IMPEDANCE, doubles(*[20000.0] * 7)),
    (Command.SET_CARTESIAN_IMPEDANCE, doubles(*[3000.0] * 6)),
    (Command.SET_GUIDING_MODE, bytes((2, 0, 1, 0, 1, 0, 1))),
    (Command.SET_EE_TO_K, doubles(*MIRRORED)),
    (Command.SET_NE_TO_EE, doubles(*[2.0] * 16)),
    (LOAD, doubles(-0.5, 0.0, 0.0, 0.1, *SOLID)),
    (LOAD, doubles(3.1, 0.0, 0.0, 0.1, *SOLID)),
    (LOAD, doubles(0.5, *[0.0] * 3, *[-1.0] * 9)),
]


@pytest.mark.parametrize(("command", "payload"), TAKEN)
def test_setting_is_taken_within_its_range(command, payload) -> None:
    assert configure(Configuration(), command, payload)[1] is Status.SUCCESS


@pytest.mark.parametrize(("command", "payload"), REFUSED)
def test_setting_is_refused_outside_its_range(command, payload) -> None:
    old = Configuration()
    new, found = configure(old, command, payload)
    assert found is Status.INVALID_ARGUMENT
    assert new is old


def test_tool_that_is_set_moves_the_reported_pose() -> None:
    robot = resting_robot()
    assert (
        robot.set(ClientRequest(Command.SET_NE_TO_EE, 1, doubles(*TURNED)))
        is Status.SUCCESS
    )
    state = State(Publisher().datagram(robot))
    assert state.place == pytest.approx(
        forward(robot.posture.q, robot.configuration.tool)[:3, 3], abs=1e-6
    )
    assert state.place != pytest.approx(forward(robot.posture.q)[:3, 3], abs=1e-2)


def test_setting_is_refused_in_a_reflex() -> None:
    robot = resting_robot()
    robot.reflex(Reflex.CARTESIAN_REFLEX)
    assert robot.mode is RobotMode.REFLEX
    asked = ClientRequest(Command.SET_COLLISION_BEHAVIOR, 1, thresholds())
    assert robot.set(asked) is Status.NOT_POSSIBLE


def felt(force, torque_limit: float, force_limit: float) -> Contact:
    payload = thresholds(torque_limit, force_limit)
    configuration, _ = configure(
        Configuration(), Command.SET_COLLISION_BEHAVIOR, payload
    )
    posture = resting_robot().posture
    return Contact.of_force(posture, configuration, np.array(force))


@pytest.mark.parametrize(
    ("force", "torque_limit", "force_limit", "reflex"),
    [
        ((0.0, 0.0, 15.0), 100.0, 20.0, None),
        ((0.0, 0.0, -25.0), 100.0, 20.0, Reflex.CARTESIAN_REFLEX),
        ((0.0, 25.0, 0.0), 5.0, 100.0, Reflex.JOINT_REFLEX),
        ((0.0, 25.0, 0.0), 100.0, 100.0, None),
    ],
)
def test_force_beyond_a_threshold_calls_for_its_reflex(
    force, torque_limit: float, force_limit: float, reflex
) -> None:
    assert felt(force, torque_limit, force_limit).reflex is reflex


@pytest.mark.parametrize(("acceleration", "stops"), [(0.0, True), (0.5, False)])
def test_accelerating_arm_has_the_thresholds_set_for_it(
    acceleration: float, stops: bool
) -> None:
    torques = [100.0] * 28
    loose, tight = [50.0] * 12, [10.0] * 12
    payload = doubles(*torques, *loose, *tight)
    configuration, _ = configure(
        Configuration(), Command.SET_COLLISION_BEHAVIOR, payload
    )
    q = resting_robot().posture.q
    rates = Rates(np.zeros(7), np.full(7, acceleration))
    posture = Posture.at_joints(q, configuration.tool, rates)
    contact = Contact.of_force(posture, configuration, np.array([0.0, 0.0, 20.0]))
    assert (contact.reflex is not None) is stops


def test_wrench_in_the_stiffness_frame_is_that_of_the_base_turned_into_it() -> None:
    robot = resting_robot(HOME + np.linspace(0.1, 0.4, 7))  # turned about every axis
    assert (
        robot.set(ClientRequest(Command.SET_EE_TO_K, 1, doubles(*TURNED)))
        is Status.SUCCESS
    )
    robot.pushed = np.array([3.0, -2.0, 5.0])
    robot.rest()
    state = State(Publisher().datagram(robot))
    in_base, in_frame = np.array(state.floats(868, 6)), np.array(state.floats(892, 6))
    frame = np.reshape(TURNED, (4, 4)).T
    pose = forward(robot.posture.q) @ frame
    # from the frame to where it is pushed
    arm = forward(robot.posture.q)[:3, 3] - pose[:3, 3]
    assert in_base[:3] == pytest.approx(robot.pushed)
    assert in_base[3:] == pytest.approx(np.cross(arm, robot.pushed), abs=1e-5)
    assert in_frame[:3] == pytest.approx(pose[:3, :3].T @ in_base[:3], abs=1e-5)
    assert in_frame[3:] == pytest.approx(pose[:3, :3].T @ in_base[3:], abs=1e-5)
