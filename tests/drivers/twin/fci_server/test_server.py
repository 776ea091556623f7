"""The server among its clients: who is let in, whose clock it follows, how it ends
motions.
"""

import socket
import struct

import pytest

from drivers.base.errors import ConfigurationError
from drivers.twin.fci_server.faults import (
    NanFault,
    UserStopFault,
)
from drivers.twin.fci_server.server import RobotServer, ServerSettings
from drivers.twin.fci_server.wire import Reflex
from tests.support.fci_wire import (
    CARTESIAN_POSE,
    CARTESIAN_VELOCITY,
    EMERGENCY_ABORTED,
    IDLE,
    MOVE,
    MOVING,
    RECOVERY,
    REFLEX,
    REFLEX_ABORTED,
    SET_COLLISION,
    STARTED,
    RawArm,
    State,
    move_request,
    robot_command,
)

# m/s, from rest within every limit of one tick
AHEAD = (0.0, 0.001, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def server():
    with RobotServer() as served:
        yield served


@pytest.fixture
def arm(server):
    with RawArm(server.address) as client:
        yield client


def drive(arm: RawArm, state: State, ticks: int, twist=AHEAD) -> State:
    for _ in range(ticks):
        state = arm.tick(state, twist=twist)
    return state


def test_robot_listens_on_a_loopback_address_of_its_own(server) -> None:
    with RobotServer() as other:
        addresses = {server.address, other.address}
    assert len(addresses) == 2
    assert all(address.startswith("127.") for address in addresses)


def test_address_that_is_taken_is_refused_by_name(server) -> None:
    with pytest.raises(ConfigurationError, match=server.address):
        RobotServer(ServerSettings(address=server.address))


def test_silent_strangers_do_not_keep_a_client_out(server) -> None:
    strangers = [socket.create_connection((server.address, 1337)) for _ in range(12)]
    with RawArm(server.address) as arm:
        assert arm.state().mode == IDLE
    for stranger in strangers:
        stranger.close()


def test_silent_client_freezes_time_and_gets_its_state_again(arm) -> None:
    state = drive(arm, arm.start_still(), 5)
    again = arm.state()
    assert again.raw == state.raw
    assert drive(arm, again, 1).message_id == state.message_id + 1


def test_command_for_an_old_state_is_not_followed(server, arm) -> None:
    state = drive(arm, arm.start_still(), 5)
    followed = server.robot.ticks
    for old in range(1, 5):
        arm.send(robot_command(state.message_id - old, twist=(0.0, 3.0, 0, 0, 0, 0)))
    drive(arm, state, 1)
    assert server.robot.ticks == followed + 1


def test_same_commands_give_the_same_bytes() -> None:
    told = []
    for _ in range(2):
        with RobotServer() as server, RawArm(server.address) as arm:
            state = arm.start_still()
            told.append([])
            for _ in range(50):
                state = arm.tick(state, twist=AHEAD)
                told[-1].append(state.raw[8:1373])
    assert told[0] == told[1]


def test_setters_are_refused_in_motion_and_taken_at_rest(arm) -> None:
    thresholds = struct.pack("<52d", *[20.0] * 52)
    assert arm.ask(SET_COLLISION, thresholds) == 0
    arm.start_still()
    assert arm.ask(SET_COLLISION, thresholds) == 1


def test_second_motion_is_refused_while_one_runs(arm) -> None:
    arm.start_still()
    assert arm.ask(MOVE, move_request(CARTESIAN_POSE)) == 5


def test_client_that_goes_in_motion_leaves_the_arm_at_rest(server) -> None:
    with RawArm(server.address) as arm:
        drive(arm, arm.start_still(), 20)
    with RawArm(server.address) as arm:
        state = arm.until(lambda state: not any(state.dq))
        assert state.mode == IDLE
        assert arm.ask(MOVE, move_request(CARTESIAN_VELOCITY)) == STARTED


def test_user_stop_that_is_released_lets_the_arm_move_again() -> None:
    fault = UserStopFault(at=10, kind="user_stop", duration=0.05)
    with RobotServer(faults=[fault]) as server, RawArm(server.address) as arm:
        state = arm.start_still()
        while state.mode == MOVING:
            state = arm.tick(state, twist=AHEAD)
        assert arm.reply()[2][0] == EMERGENCY_ABORTED
        assert arm.ask(RECOVERY) == 1
        arm.until(lambda after: after.mode == IDLE)
        assert arm.ask(MOVE, move_request(CARTESIAN_VELOCITY)) == STARTED


def test_robot_on_the_wall_clock_stops_by_itself_when_its_client_falls_silent() -> None:
    with (
        RobotServer(ServerSettings(lock_step=False)) as server,
        RawArm(server.address) as arm,
    ):
        state = arm.begin(CARTESIAN_VELOCITY)
        for _ in range(30):
            arm.send(robot_command(state.message_id))
            state = arm.newest()
        state = arm.until(lambda state: state.mode == REFLEX)
        assert state.errors == [Reflex.COMMUNICATION_CONSTRAINTS_VIOLATION]
        assert arm.reply()[2][0] == REFLEX_ABORTED


def test_nan_state_lasts_as_scripted() -> None:
    fault = NanFault(at=10, kind="nan", ticks=3)
    with RobotServer(faults=[fault]) as server, RawArm(server.address) as arm:
        state, broken = arm.start_still(), 0
        for _ in range(30):
            state = arm.tick(state, twist=AHEAD)
            broken += state.q[0] != state.q[0]
        assert broken == 3
