"""The hand among its clients: it closes on what is there, can be stopped, keeps robot
time.
"""

import socket
import struct

import pytest

from drivers.twin.fci_server.server import RobotServer
from tests.support.fci_wire import RawArm

HOMING, GRASP, MOVE, STOP = 1, 2, 3, 4
OK, FAIL, UNSUCCESSFUL, ABORTED = 0, 1, 2, 3


class RawHand:
    """One connection to the hand, in bytes."""

    def __init__(self, address: str, version: int = 3) -> None:
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 0))
        self.udp.settimeout(3)
        self.tcp = socket.create_connection((address, 1338), 3)
        self.send(0, struct.pack("<HH", version, self.udp.getsockname()[1]))
        self.connected = struct.unpack("<HIIHH", self.tcp.recv(14))[3:]

    def __enter__(self) -> "RawHand":
        return self

    def __exit__(self, *_: object) -> None:
        self.tcp.close()
        self.udp.close()

    def send(self, command: int, payload: bytes = b"", command_id: int = 1) -> None:
        header = struct.pack("<HII", command, command_id, 10 + len(payload))
        self.tcp.sendall(header + payload)

    def reply(self) -> tuple[int, int, int]:
        """Command, id, status."""
        command, command_id, size, status = struct.unpack("<HIIH", self.tcp.recv(12))
        assert size == 12
        return command, command_id, status

    def state(self) -> tuple[int, float]:
        """Time [ms], width [m]."""
        return struct.unpack("<IddBH", self.udp.recv(64))[:2]


@pytest.fixture
def server():
    with RobotServer(between=lambda: 0.01) as served:
        yield served


@pytest.fixture
def hand(server):
    with RawHand(server.address) as client:
        assert client.connected == (OK, 3)
        yield client


def grasp(width: float = 0.01, speed: float = 0.1) -> bytes:
    return struct.pack("<5d", width, 0.005, 0.005, speed, 20.0)


def test_grasp_of_another_width_is_unsuccessful(hand) -> None:
    hand.send(GRASP, grasp(width=0.04))
    assert hand.reply() == (GRASP, 1, UNSUCCESSFUL)


def test_stop_interrupts_a_motion_and_answers_both(hand) -> None:
    hand.send(MOVE, struct.pack("<2d", 0.04, 0.001), command_id=5)
    hand.send(STOP, command_id=6)
    assert hand.reply() == (MOVE, 5, ABORTED)
    assert hand.reply() == (STOP, 6, OK)


def test_replies_to_a_client_that_is_gone_reach_no_other(server) -> None:
    with RawHand(server.address) as gone:
        gone.send(MOVE, struct.pack("<2d", 0.04, 0.1), command_id=5)
        gone.state()
    with RawHand(server.address) as hand:
        hand.send(STOP, command_id=6)
        assert hand.reply() == (STOP, 6, OK)


@pytest.mark.parametrize(
    "numbers",
    [(0.5, 0.1), (-0.1, 0.1), (0.04, 0.0), (float("nan"), 0.1), (0.04, float("inf"))],
)
def test_motion_that_cannot_be_fails(hand, numbers) -> None:
    hand.send(MOVE, struct.pack("<2d", *numbers))
    assert hand.reply() == (MOVE, 1, FAIL)


def test_hand_moves_in_the_robots_time_while_the_arm_is_commanded(server, hand) -> None:
    with RawArm(server.address) as arm:
        state = arm.start_still()
        hand.send(MOVE, struct.pack("<2d", 0.04, 0.1))
        for _ in range(100):
            state = arm.tick(state)
        assert server.hand.width == pytest.approx(0.08 - 0.1 * 0.1, abs=2e-4)
        time, width = hand.state()
        while time < state.message_id - 5:
            before, (time, width) = time, hand.state()
        assert time - before == 5
        assert width == pytest.approx(server.hand.width, abs=1e-3)
