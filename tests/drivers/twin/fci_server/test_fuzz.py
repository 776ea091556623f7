"""Garbage on every port, after which the server still serves.

`python -m tests.lab fuzz-packets` sends more of it, by TIMES and SEED.
"""

import contextlib
import os
import socket
import struct

import numpy as np
import pytest

from drivers.franka.kinematics import HOME
from drivers.twin.fci_server.robot import resting_robot
from drivers.twin.fci_server.server import RobotServer
from drivers.twin.fci_server.wire import (
    ClientRequest,
    Command,
    MoveRequest,
    RobotCommand,
)
from tests.support.fci_wire import (
    CARTESIAN_VELOCITY,
    IDLE,
    RawArm,
    move_request,
    robot_command,
)

TIMES, SEED = "CELL_FUZZ_TIMES", "CELL_FUZZ_SEED"
PACKETS = 100_000  # of all tests, as often as TIMES says
SHARE = float(os.environ.get(TIMES, "1"))
DATAGRAMS, BATCH = int(70_000 * SHARE), 100
STREAMS, IN_STREAM = int(1_000 * SHARE), 20
REQUESTS, IN_SESSION = int(8_000 * SHARE), 100
TRIES = 100  # of a connection
COMMANDS = int(2_000 * SHARE)


@pytest.fixture
def random():
    return np.random.default_rng(int(os.environ.get(SEED, "15")))


@pytest.fixture
def server():
    with RobotServer() as served:
        yield served


def assert_serves(server: RobotServer) -> None:
    with RawArm(server.address) as arm:
        assert arm.until(lambda state: not any(state.dq)).mode in (IDLE, 4)
        assert arm.ask(10) == 0
        state = arm.start_still(CARTESIAN_VELOCITY)
        assert arm.tick(state).message_id == state.message_id + 1


def noise(random, size: int) -> bytes:
    return random.bytes(size)


@pytest.mark.slow
def test_datagrams_of_garbage_in_a_motion_change_nothing(server, random) -> None:
    with RawArm(server.address) as arm:
        state = arm.start_still()
        start = state.q
        for _ in range(DATAGRAMS // BATCH):
            for size in random.integers(0, 600, BATCH - 1):
                arm.send(noise(random, 371 if size < 60 else int(size)))
            arm.send(robot_command(state.message_id)[:370])
            state = arm.tick(state)
        assert state.q == pytest.approx(start, abs=1e-6)
        assert server.robot.moving
    assert_serves(server)


@pytest.mark.parametrize("port", [1337, 1338])
def test_streams_of_garbage_end_and_hold_nobody_up(server, random, port: int) -> None:
    header = "<III" if port == 1337 else "<HII"
    for _ in range(STREAMS // 2):
        stream = socket.create_connection((server.address, port), 3)
        with stream, contextlib.suppress(OSError):
            for _ in range(IN_STREAM):
                command, size = (int(part) for part in random.integers(0, 600, 2))
                payload = noise(random, size % 50)
                stream.sendall(struct.pack(header, command % 14, 1, size) + payload)
    assert_serves(server)


@pytest.mark.parametrize("generator", [1, 2, 3, 4])
def test_commands_of_garbage_for_the_right_state_end_the_motion_and_no_more(
    generator, random
):
    robot = resting_robot()
    for _ in range(COMMANDS // 4):
        request = ClientRequest(Command.MOVE, 1, move_request(generator - 1))
        robot.move(MoveRequest.read(request), 1)
        scale = 10.0 ** random.uniform(-9, 9)
        numbers = (scale * random.normal(size=38)).tolist()
        if random.random() < 0.5:
            numbers = struct.unpack("<38d", noise(random, 304))
        packet = struct.pack("<Q38d", robot.time, *numbers) + noise(random, 59)
        robot.step(RobotCommand.read(packet))
        robot.recover(1)
        while not (robot.posture.at_rest and robot.motion is None):
            robot.stop(1)
            robot.rest()
        robot.rest()
        assert np.isfinite(robot.posture.q).all()
        assert np.abs(robot.posture.q - HOME).max() < 1e-3


def welcomed(address: str) -> RawArm:
    """A connection; the server resets those that come before it saw the last one
    end.
    """
    for _ in range(TRIES):
        with contextlib.suppress(ConnectionResetError):
            return RawArm(address)
    pytest.fail(f"reset {TRIES} times")


def test_requests_of_garbage_from_a_connected_client_are_answered_or_end_it(
    server, random
) -> None:
    for _ in range(REQUESTS // IN_SESSION):
        with welcomed(server.address) as arm, contextlib.suppress(OSError):
            for _ in range(IN_SESSION):
                number = int(random.integers(1, 12))
                size = {1: 113, 3: 416, 4: 56, 5: 48, 6: 7, 7: 128, 8: 128, 9: 104}.get(
                    number, 0
                )
                arm.request(number, noise(random, size))
            arm.tcp.settimeout(0.01)
            arm.tcp.recv(4096)
    assert_serves(server)
