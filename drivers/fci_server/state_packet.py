"""The arm's state datagram over UDP: 1377 bytes, most of them float32."""

from itertools import accumulate
from struct import Struct

import numpy as np

from drivers.fci_server.reflex import Reflex
from drivers.fci_server.wire import Controller, Generator, Mode
from drivers.types import Array

PACKET_SIZE = 1377
FLAG_COUNT = 41
PACKET_FIELDS = (
    ("O_T_EE", 16),
    ("O_T_EE_d", 16),
    ("F_T_EE", 16),
    ("EE_T_K", 16),
    ("F_T_NE", 16),
    ("NE_T_EE", 16),
    ("m_ee", 1),
    ("I_ee", 9),
    ("F_x_Cee", 3),
    ("m_load", 1),
    ("I_load", 9),
    ("F_x_Cload", 3),
    ("elbow", 2),
    ("elbow_d", 2),
    ("tau_J", 7),
    ("tau_J_d", 7),
    ("dtau_J", 7),
    ("q", 7),
    ("q_d", 7),
    ("dq", 7),
    ("dq_d", 7),
    ("ddq_d", 7),
    ("joint_contact", 7),
    ("cartesian_contact", 6),
    ("joint_collision", 7),
    ("cartesian_collision", 6),
    ("tau_ext_hat_filtered", 7),
    ("O_F_ext_hat_K", 6),
    ("K_F_ext_hat_K", 6),
    ("O_dP_EE_d", 6),
    ("O_ddP_O", 3),
    ("elbow_c", 2),
    ("delbow_c", 2),
    ("ddelbow_c", 2),
    ("O_T_EE_c", 16),
    ("O_dP_EE_c", 6),
    ("O_ddP_EE_c", 6),
    ("theta", 7),
    ("dtheta", 7),
    ("accelerometers", 36),
)
_FLOATS = sum(count for _, count in PACKET_FIELDS)
_TAIL = 8 + 4 * _FLOATS
_ERRORS, _REASONS = _TAIL + 2, _TAIL + 2 + FLAG_COUNT
_MODE = _REASONS + FLAG_COUNT
_TIME, _RATE = Struct("<Q"), Struct("<f")
_LAYOUT = Struct(f"<Q{_FLOATS}fBB{FLAG_COUNT}s{FLAG_COUNT}sBf")


class StatePacket:
    """One datagram, written in place: `fields[name]` are float32 views into it."""

    def __init__(self) -> None:
        if _LAYOUT.size != PACKET_SIZE:
            raise ValueError(f"the layout has {_LAYOUT.size} bytes, the wire {PACKET_SIZE}")
        self._bytes = bytearray(PACKET_SIZE)
        ends = accumulate(count for _, count in PACKET_FIELDS)
        views = np.split(np.frombuffer(self._bytes, "<f4", _FLOATS, 8), list(ends)[:-1])
        self.fields = {name: view for (name, _), view in zip(PACKET_FIELDS, views, strict=True)}

    def put_matrix(self, name: str, matrix: Array) -> None:
        """Write a matrix (n, n) column by column."""
        self.fields[name][:] = matrix.T.ravel()

    def put_modes(self, generator: Generator, controller: Controller, mode: Mode) -> None:
        """Write the motion generator, the controller and the robot mode."""
        self._bytes[_TAIL] = generator
        self._bytes[_TAIL + 1] = controller
        self._bytes[_MODE] = mode

    def put_errors(self, errors: frozenset[Reflex], reasons: frozenset[Reflex]) -> None:
        """Write the current errors, and those that ended the last motion."""
        for start, flags in ((_ERRORS, errors), (_REASONS, reasons)):
            self._bytes[start : start + FLAG_COUNT] = bytes(FLAG_COUNT)
            for flag in flags:
                self._bytes[start + flag] = 1

    def seal(self, message_id: int, success_rate: float) -> bytes:
        """Bytes of the datagram, with robot time [ms] and the fraction of commands in time."""
        _TIME.pack_into(self._bytes, 0, message_id)
        _RATE.pack_into(self._bytes, _MODE + 1, success_rate)
        return bytes(self._bytes)
