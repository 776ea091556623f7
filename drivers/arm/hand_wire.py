"""The hand's protocol, version 3: packed, little-endian; commands over TCP, states over UDP.

The library's client blocks its whole process while the fingers move and cannot be interrupted, so
the cell implements the protocol itself.
"""

from dataclasses import dataclass
from struct import Struct

from drivers.franka.hand_protocol import (
    HEADER,
    PAYLOAD,
    PROTOCOL_VERSION,
    STATE_PACKET,
    HandCommand,
)

NUMBER = Struct("<H")  # a status or a version
LONGEST_REPLY = 64  # bytes; version 3 sends at most 14


@dataclass(frozen=True, slots=True)
class Reply:
    """Reply at the end of command `number`; `version` only in the reply to a connection."""

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


def request(command: HandCommand, number: int, *values: float) -> bytes:
    """Bytes of a request of the hand's protocol, with its `values`."""
    payload = PAYLOAD[command].pack(*values)
    return HEADER.pack(command, number, HEADER.size + len(payload)) + payload


def connect(number: int, port: int) -> bytes:
    """Request to connect, with states sent to UDP `port`."""
    return request(HandCommand.CONNECT, number, PROTOCOL_VERSION, port)


def homing(number: int) -> bytes:
    """Request to close and open the fingers, after which the hand knows their width."""
    return request(HandCommand.HOMING, number)


def move(number: int, width: float, speed: float) -> bytes:
    """Request to move the fingers to `width` [m] at `speed` [m/s]."""
    return request(HandCommand.MOVE, number, width, speed)


def grasp(number: int, thinnest: float, thickest: float, speed: float, force: float) -> bytes:
    """Request to close with `force` [N] on an object `thinnest` to `thickest` [m] thick."""
    width, slack = (thinnest + thickest) / 2, (thickest - thinnest) / 2
    return request(HandCommand.GRASP, number, width, slack, slack, speed, force)


def replies(received: bytearray) -> list[Reply]:
    """Remove the complete replies from the front of `received` and return them.

    Raises ConnectionError for a reply of a size that none has, after which no other can be read.
    """
    found: list[Reply] = []
    version_at = HEADER.size + NUMBER.size  # behind the status
    while len(received) >= version_at:
        command, number, size = HEADER.unpack_from(received)
        if not version_at <= size <= LONGEST_REPLY:
            raise ConnectionError(f"it sent a reply of {size} bytes")
        if len(received) < size:
            break
        (status,) = NUMBER.unpack_from(received, HEADER.size)
        has_version = size >= version_at + NUMBER.size
        version = NUMBER.unpack_from(received, version_at)[0] if has_version else None
        found.append(Reply(command, number, status, version))
        del received[:size]
    return found


def state(packet: bytes) -> Fingers | None:
    """State of the hand from a datagram; None where the datagram holds none."""
    if len(packet) != STATE_PACKET.size:
        return None
    number, width, widest, grasped, _ = STATE_PACKET.unpack(packet)
    return Fingers(number, width, widest, bool(grasped))
