"""The hand among its clients: it closes on what is there, can be stopped, keeps robot
time.
"""

import struct

import pytest

from drivers.twin.fci_server.server import RobotServer
from tests.support.fci_wire import RawArm

HOMING, GRASP, MOVE, STOP = 1, 2, 3, 4
OK, FAIL, UNSUCCESSFUL, ABORTED = 0, 1, 2, 3


class RawHand(RawArm):
    """One connection to the hand, in bytes."""

    PORT, HEADER, CONNECTED = 1338, "<HII", "<HH"

    def __init__(self, address: str) -> None:
        super().__init__(address, version=3)

    def width(self) -> tuple[int, float]:
        """Time [ms], width [m]."""
        return struct.unpack("<IddBH", self.udp.recv(64))[:2]


def _answered(hand: RawHand, command: int, asked: int, status: int) -> None:
    assert hand.reply() == (command, asked, struct.pack("<H", status))


@pytest.fixture
def server():
    with RobotServer(between=lambda: 0.01) as served:
        yield served


@pytest.fixture
def hand(server):
    with RawHand(server.address) as client:
        assert client.connected == (OK, 3)
        yield client


def test_grasp_of_another_width_is_unsuccessful(hand) -> None:
    asked = hand.request(GRASP, struct.pack("<5d", 0.04, 0.005, 0.005, 0.1, 20.0))
    _answered(hand, GRASP, asked, UNSUCCESSFUL)


def test_stop_interrupts_a_motion_and_answers_both(hand) -> None:
    move = hand.request(MOVE, struct.pack("<2d", 0.04, 0.001))
    stop = hand.request(STOP)
    _answered(hand, MOVE, move, ABORTED)
    _answered(hand, STOP, stop, OK)


def test_replies_to_a_client_that_is_gone_reach_no_other(server) -> None:
    with RawHand(server.address) as gone:
        gone.request(MOVE, struct.pack("<2d", 0.04, 0.1))
        gone.width()
    with RawHand(server.address) as hand:
        _answered(hand, STOP, hand.request(STOP), OK)


@pytest.mark.parametrize(
    "numbers",
    [(0.5, 0.1), (-0.1, 0.1), (0.04, 0.0), (float("nan"), 0.1), (0.04, float("inf"))],
)
def test_motion_that_cannot_be_fails(hand, numbers) -> None:
    _answered(hand, MOVE, hand.request(MOVE, struct.pack("<2d", *numbers)), FAIL)


def test_hand_moves_in_the_robots_time_while_the_arm_is_commanded(server, hand) -> None:
    with RawArm(server.address) as arm:
        state = arm.start_still()
        hand.request(MOVE, struct.pack("<2d", 0.04, 0.1))
        for _ in range(100):
            state = arm.tick(state)
        assert server.hand.width == pytest.approx(0.08 - 0.1 * 0.1, abs=2e-4)
        time, width = hand.width()
        while time < state.message_id - 5:
            before, (time, width) = time, hand.width()
        assert time - before == 5
        assert width == pytest.approx(server.hand.width, abs=1e-3)
