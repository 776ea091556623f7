"""Messages of the hand's protocol, version 3: little-endian, packed."""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct

from drivers.fci_server.wire import Malformed

PROTOCOL_VERSION = 3
PORT = 1338
HEADER = Struct("<HII")  # command, command id, size with header
CONNECTED = Struct("<HH")  # status, version of the server
STATE_PACKET = Struct("<IddBH")  # time [ms], width [m], largest width [m], grasped, temperature [C]
STATUS = Struct("<H")


class HandCommand(IntEnum):
    """Commands of a client to the hand."""

    CONNECT = 0
    HOMING = 1
    GRASP = 2
    MOVE = 3
    STOP = 4


PAYLOAD = {
    HandCommand.CONNECT: Struct("<HH"),
    HandCommand.HOMING: Struct("<"),
    HandCommand.GRASP: Struct("<5d"),  # width, epsilon inner, outer [m], speed [m/s], force [N]
    HandCommand.MOVE: Struct("<2d"),  # width [m], speed [m/s]
    HandCommand.STOP: Struct("<"),
}


class HandStatus(IntEnum):
    """How a command of the hand ended."""

    SUCCESS = 0
    FAIL = 1
    UNSUCCESSFUL = 2
    ABORTED = 3


@dataclass(frozen=True, slots=True)
class HandRequest:
    """One request to the hand with its numbers."""

    command: HandCommand
    command_id: int
    values: tuple[float, ...]


def take_request(buffer: bytearray) -> HandRequest | None:
    """Remove the first whole request from the received bytes; None while it is incomplete.

    Raises Malformed for an unknown command or a wrong size.
    """
    if len(buffer) < HEADER.size:
        return None
    number, command_id, size = HEADER.unpack_from(buffer)
    if number not in tuple(HandCommand):
        raise Malformed(f"hand command {number} is unknown")
    command = HandCommand(number)
    payload = PAYLOAD[command]
    if size != HEADER.size + payload.size:
        raise Malformed(f"hand's {command.name} of {size} bytes")
    if len(buffer) < size:
        return None
    values = payload.unpack_from(buffer, HEADER.size)
    del buffer[:size]
    return HandRequest(command, command_id, values)


def reply(command: HandCommand, command_id: int, content: bytes) -> bytes:
    """One reply over TCP; `content` starts with its status."""
    return HEADER.pack(command, command_id, HEADER.size + len(content)) + content
