"""Sizes, offsets and numbers on the wire, as the protocol's description gives them."""

import struct

import numpy as np
import pytest

from drivers.franka.hand_protocol import STATE_PACKET
from drivers.twin.fci_server import wire
from drivers.twin.fci_server.hand import EmulatedHand
from drivers.twin.fci_server.state import PACKET
from drivers.twin.fci_server.wire import ARM_FRAMING, HAND_FRAMING, Malformed
from tests.support.fci_wire import State, robot_command

# Command id, bytes of payload.
REQUESTS = [
    (0, 4),
    (1, 113),
    (2, 0),
    (3, 416),
    (4, 56),
    (5, 48),
    (6, 7),
    (7, 128),
    (8, 128),
    (9, 104),
    (10, 0),
    (11, 0),
]
# Field, count, byte offset; each is where the one before it ends.
FLOATS = (
    "O_T_EE 16, O_T_EE_d 16, F_T_EE 16, EE_T_K 16, F_T_NE 16, NE_T_EE 16, m_ee 1, I_ee"
    " 9, F_x_Cee 3, m_load 1, I_load 9, F_x_Cload 3, elbow 2, elbow_d 2, tau_J 7,"
    " tau_J_d 7, dtau_J 7, q 7, q_d 7, dq 7, dq_d 7, ddq_d 7, joint_contact 7,"
    " cartesian_contact 6, joint_collision 7, cartesian_collision 6,"
    " tau_ext_hat_filtered 7, O_F_ext_hat_K 6, K_F_ext_hat_K 6, O_dP_EE_d 6, O_ddP_O 3,"
    " elbow_c 2, delbow_c 2, ddelbow_c 2, O_T_EE_c 16, O_dP_EE_c 6, O_ddP_EE_c 6, theta"
    " 7, dtheta 7, accelerometers 36"
)


def frame(number: int, payload: bytes, command_id: int = 7) -> bytearray:
    return bytearray(
        struct.pack("<III", number, command_id, 12 + len(payload)) + payload
    )


@pytest.mark.parametrize(("number", "size"), REQUESTS)
def test_request_is_taken_at_its_size_and_at_no_other(number: int, size: int) -> None:
    buffer = frame(number, bytes(size)) + b"rest"
    request = ARM_FRAMING.take(buffer)
    assert request is not None
    assert (request.command, request.command_id, len(request.payload)) == (
        number,
        7,
        size,
    )
    assert buffer == b"rest"
    assert ARM_FRAMING.take(frame(number, bytes(size))[:-1]) is None
    with pytest.raises(Malformed):
        ARM_FRAMING.take(frame(number, bytes(size + 1)))


def test_state_is_1377_bytes_with_every_field_in_its_place() -> None:
    offset = 8
    for text in FLOATS.split(", "):
        name, count = text.split()
        packet = np.zeros((), PACKET)
        packet[name] = np.arange(int(count)) + offset
        found = State(packet.tobytes()).floats(offset, int(count))
        assert found == tuple(np.arange(int(count)) + offset), name
        offset += 4 * int(count)
    assert offset == 1288
    assert PACKET.itemsize == 1377


def test_command_is_371_bytes_column_by_column() -> None:
    pose = (1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.1, 0.2, 0.3, 1)
    packet = robot_command(
        9, q=range(7), dq=range(7, 14), pose=pose, twist=range(6), finished=True
    )
    assert len(packet) == 371
    command = wire.RobotCommand.read(packet)
    assert command.message_id == 9
    assert command.finished
    assert command.elbow is None
    assert list(command.q) == list(range(7))
    assert list(command.dq) == list(range(7, 14))
    assert list(command.pose[:3, 3]) == [0.1, 0.2, 0.3]
    assert list(command.twist) == list(range(6))


HAND_REQUESTS = [(0, 4), (1, 0), (2, 40), (3, 16), (4, 0)]


@pytest.mark.parametrize(("number", "size"), HAND_REQUESTS)
def test_hand_takes_requests_under_a_header_of_ten_bytes(
    number: int, size: int
) -> None:
    content = bytearray(struct.pack("<HII", number, 7, 10 + size) + bytes(size))
    request = HAND_FRAMING.take(content)
    assert request is not None
    assert (request.command, request.command_id) == (number, 7)
    assert not content


def test_hand_state_is_23_bytes_and_replies_12() -> None:
    assert STATE_PACKET.pack(1, 0.04, 0.08, True, 30) == (
        struct.pack("<I", 1)
        + struct.pack("<dd", 0.04, 0.08)
        + b"\x01"
        + struct.pack("<H", 30)
    )
    assert STATE_PACKET.size == 23
    hand = EmulatedHand(lambda: None)
    stop = bytearray(struct.pack("<HII", 4, 3, 10))
    request = HAND_FRAMING.take(stop)
    assert request is not None
    hand.begin(request)
    assert hand.replies == [struct.pack("<HIIH", 4, 3, 12, 0)]
