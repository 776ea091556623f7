"""Messages of the hand's protocol, version 3: little-endian, packed."""

from dataclasses import dataclass
from struct import Struct

from drivers.fci_server.wire import Malformed
from drivers.franka.hand_protocol import HEADER, PAYLOAD, HandCommand

CONNECTED = Struct("<HH")  # status, version of the server
STATUS = Struct("<H")


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
    """Bytes of one reply over TCP; `content` starts with its status."""
    return HEADER.pack(command, command_id, HEADER.size + len(content)) + content
