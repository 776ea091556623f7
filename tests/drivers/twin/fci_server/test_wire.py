"""The state's layout on the wire, as the protocol's description gives it; other clients
read less of it.
"""

import struct

import numpy as np
import pytest

from drivers.twin.fci_server.state import PACKET
from drivers.twin.fci_server.wire import ARM_FRAMING, Malformed
from tests.support.fci_wire import State

# Field and count; each begins where the one before it ends.
FLOATS = (
    "O_T_EE 16, O_T_EE_d 16, F_T_EE 16, EE_T_K 16, F_T_NE 16, NE_T_EE 16, m_ee 1, I_ee"
    " 9, F_x_Cee 3, m_load 1, I_load 9, F_x_Cload 3, elbow 2, elbow_d 2, tau_J 7,"
    " tau_J_d 7, dtau_J 7, q 7, q_d 7, dq 7, dq_d 7, ddq_d 7, joint_contact 7,"
    " cartesian_contact 6, joint_collision 7, cartesian_collision 6,"
    " tau_ext_hat_filtered 7, O_F_ext_hat_K 6, K_F_ext_hat_K 6, O_dP_EE_d 6, O_ddP_O 3,"
    " elbow_c 2, delbow_c 2, ddelbow_c 2, O_T_EE_c 16, O_dP_EE_c 6, O_ddP_EE_c 6, theta"
    " 7, dtheta 7, accelerometers 36"
)


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


def test_request_of_another_size_is_malformed_and_half_of_one_is_waited_for() -> None:
    whole = struct.pack("<III", 6, 7, 19) + bytes(7)
    assert ARM_FRAMING.take(bytearray(whole[:-1])) is None
    with pytest.raises(Malformed):
        ARM_FRAMING.take(bytearray(struct.pack("<III", 6, 7, 20) + bytes(8)))
