"""The Franka Hand's protocol, version 3, packed and little-endian: commands, layouts,
numbers.
"""

from enum import IntEnum
from struct import Struct

PROTOCOL_VERSION = 3
PORT = 1338
HEADER = Struct("<HII")  # command, command id, size with header
# time [ms], width [m], largest width [m], grasped, temperature [C]
STATE_PACKET = Struct("<IddBH")


class HandCommand(IntEnum):
    """Commands of a client to the Franka Hand, by their number in its protocol."""

    CONNECT = 0
    HOMING = 1
    GRASP = 2
    MOVE = 3
    STOP = 4


PAYLOAD = {
    HandCommand.CONNECT: Struct("<HH"),  # version, UDP port
    HandCommand.HOMING: Struct("<"),
    # width, epsilon inner, outer [m], speed [m/s], force [N]
    HandCommand.GRASP: Struct("<5d"),
    HandCommand.MOVE: Struct("<2d"),  # width [m], speed [m/s]
    HandCommand.STOP: Struct("<"),
}


class HandStatus(IntEnum):
    """Outcome of a command to the Franka Hand, as its reply states it."""

    SUCCESS = 0
    FAIL = 1
    UNSUCCESSFUL = 2
    ABORTED = 3
