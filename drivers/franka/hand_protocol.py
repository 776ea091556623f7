"""The Franka Hand's protocol, version 3, packed and little-endian: commands, layouts,
numbers.
"""

from enum import IntEnum
from struct import Struct
from typing import Self

PROTOCOL_VERSION = 3
PORT = 1338
HEADER = Struct("<HII")  # command, command id, size with header
# time [ms], width [m], largest width [m], grasped, temperature [C]
STATE_PACKET = Struct("<IddBH")


class RequestKind(IntEnum):
    """Requests of a protocol, by their number in it, each with its payload's
    `layout`.
    """

    layout: Struct

    def __new__(cls, number: int, layout: str = "") -> Self:
        """Kind of request that equals its `number`."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.layout = Struct(f"<{layout}")
        return member


class HandCommand(RequestKind):
    """Commands of a client to the Franka Hand, by their number in its protocol."""

    CONNECT = 0, "HH"  # version, UDP port
    HOMING = 1
    GRASP = 2, "5d"  # width, epsilon inner, outer [m], speed [m/s], force [N]
    MOVE = 3, "2d"  # width [m], speed [m/s]
    STOP = 4


class HandStatus(IntEnum):
    """Outcome of a command to the Franka Hand, as its reply states it."""

    SUCCESS = 0
    FAIL = 1
    UNSUCCESSFUL = 2
    ABORTED = 3
