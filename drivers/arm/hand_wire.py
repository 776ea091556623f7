"""The hand's protocol, version 3: packed, little-endian; commands over TCP, states over UDP.

The library's client blocks its whole process while the fingers move and cannot be interrupted, so
the cell implements the protocol itself.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

PROTOCOL_VERSION = 3
PORT = 1338
HEADER = struct.Struct("<HII")
STATE_PACKET = struct.Struct("<IddBH")


class Command(IntEnum):
    """Commands of the hand."""

    CONNECT = 0
    HOMING = 1
    GRASP = 2
    MOVE = 3
    STOP = 4


class Status(IntEnum):
    """How a command ended."""

    SUCCESS = 0
    FAIL = 1
    UNSUCCESSFUL = 2
    ABORTED = 3


@dataclass(frozen=True, slots=True)
class Reply:
    """The end of command `number`; `version` only in the reply to a connection."""

    command: int
    number: int
    status: int
    version: int | None = None


@dataclass(frozen=True, slots=True)
class Fingers:
    """State of the hand: `width` between the fingers [m] and whether they hold something."""

    number: int
    width: float
    widest: float
    grasped: bool


def request(command: Command, number: int, payload: bytes = b"") -> bytes:
    """A command of the hand's protocol as bytes."""
    return HEADER.pack(command, number, HEADER.size + len(payload)) + payload


def connect(number: int, port: int) -> bytes:
    """Request to connect, with states sent to UDP `port`."""
    return request(Command.CONNECT, number, struct.pack("<HH", PROTOCOL_VERSION, port))


def homing(number: int) -> bytes:
    """Close and open the fingers, after which the hand knows their width."""
    return request(Command.HOMING, number)


def move(number: int, width: float, speed: float) -> bytes:
    """Move the fingers to `width` [m] at `speed` [m/s]."""
    return request(Command.MOVE, number, struct.pack("<2d", width, speed))


def grasp(number: int, thinnest: float, thickest: float, speed: float, force: float) -> bytes:
    """Close with `force` [N] on an object `thinnest` to `thickest` [m] thick."""
    width, slack = (thinnest + thickest) / 2, (thickest - thinnest) / 2
    return request(Command.GRASP, number, struct.pack("<5d", width, slack, slack, speed, force))


def replies(received: bytearray) -> list[Reply]:
    """Remove the complete replies from the front of `received` and return them."""
    found: list[Reply] = []
    while len(received) >= HEADER.size + 2:
        command, number, size = HEADER.unpack_from(received)
        if len(received) < size or size < HEADER.size + 2:
            break
        (status,) = struct.unpack_from("<H", received, HEADER.size)
        version = struct.unpack_from("<H", received, HEADER.size + 2)[0] if size >= 14 else None
        found.append(Reply(command, number, status, version))
        del received[:size]
    return found


def state(packet: bytes) -> Fingers | None:
    """State of the hand from a datagram; None where the datagram holds none."""
    if len(packet) != STATE_PACKET.size:
        return None
    number, width, widest, grasped, _ = STATE_PACKET.unpack(packet)
    return Fingers(number, width, widest, bool(grasped))
