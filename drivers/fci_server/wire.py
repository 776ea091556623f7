"""Messages of the arm's protocol, server version 10: little-endian, packed."""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import Self

import numpy as np

from drivers.types import Array

PROTOCOL_VERSION = 10
PORT = 1337
HEADER = Struct("<III")  # command, command id, size with header
CONNECT_REQUEST = Struct("<HH")  # version, UDP port of the client
CONNECTED = Struct("<BH")  # status, version of the server
MOVE = Struct("<II6dB7d")
MESSAGE, COMMAND_NUMBERS = Struct("<Q"), 38
COMMAND = Struct(f"<Q{COMMAND_NUMBERS}dBB7dB")  # the state that it answers, numbers, flags
FLAGS_OFFSET = MESSAGE.size + 8 * COMMAND_NUMBERS
LARGEST_NUMBER = 1e6  # in any unit; no command is near it


class Command(IntEnum):
    """Commands of a client over TCP."""

    CONNECT = 0
    MOVE = 1
    STOP_MOVE = 2
    SET_COLLISION_BEHAVIOR = 3
    SET_JOINT_IMPEDANCE = 4
    SET_CARTESIAN_IMPEDANCE = 5
    SET_GUIDING_MODE = 6
    SET_EE_TO_K = 7
    SET_NE_TO_EE = 8
    SET_LOAD = 9
    AUTOMATIC_ERROR_RECOVERY = 10
    GET_ROBOT_MODEL = 11


PAYLOAD = {
    Command.CONNECT: 4,
    Command.MOVE: 113,
    Command.STOP_MOVE: 0,
    Command.SET_COLLISION_BEHAVIOR: 416,
    Command.SET_JOINT_IMPEDANCE: 56,
    Command.SET_CARTESIAN_IMPEDANCE: 48,
    Command.SET_GUIDING_MODE: 7,
    Command.SET_EE_TO_K: 128,
    Command.SET_NE_TO_EE: 128,
    Command.SET_LOAD: 104,
    Command.AUTOMATIC_ERROR_RECOVERY: 0,
    Command.GET_ROBOT_MODEL: 0,
}  # bytes


class Status(IntEnum):
    """Status in the replies to all requests but a motion."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    INVALID_ARGUMENT = 2


class MoveStatus(IntEnum):
    """Status in the replies to a motion: MOTION_STARTED at once, another at its end."""

    SUCCESS = 0
    MOTION_STARTED = 1
    PREEMPTED = 2
    NOT_POSSIBLE = 5
    SINGULAR_START = 6
    INVALID_ARGUMENT = 7
    REFLEX_ABORTED = 8
    EMERGENCY_ABORTED = 9
    INPUT_ERROR_ABORTED = 10
    ABORTED = 11


class Generator(IntEnum):
    """Motion generators as numbered in the state; a request numbers them from one less."""

    IDLE = 0
    JOINT_POSITION = 1
    JOINT_VELOCITY = 2
    CARTESIAN_POSE = 3
    CARTESIAN_VELOCITY = 4
    NONE = 5


class Controller(IntEnum):
    """Controllers that can follow the commands, by their number in the protocol."""

    JOINT_IMPEDANCE = 0
    CARTESIAN_IMPEDANCE = 1
    EXTERNAL = 2
    OTHER = 3


class Mode(IntEnum):
    """Modes of the robot, as numbered in its state."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    RECOVERY = 6


class Malformed(Exception):
    """Bytes that are not a message of the protocol; the connection is closed."""


@dataclass(frozen=True, slots=True)
class Request:
    """One request over TCP: command, id, payload of the length given in PAYLOAD."""

    command: Command
    command_id: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class MoveRequest:
    """The request for a motion; `generator` and `controller` as numbered by the client."""

    controller: int
    generator: int
    deviations: tuple[float, ...]
    use_async: bool

    @classmethod
    def read(cls, payload: bytes) -> Self:
        """Parse the payload (113 bytes) of a request to move."""
        controller, generator, *rest = MOVE.unpack(payload)
        return cls(controller, generator, tuple(rest[:6]), bool(rest[6]))


@dataclass(frozen=True, slots=True)
class RobotCommand:
    """One command over UDP in answer to state `message_id`; a generator reads its own field."""

    message_id: int
    q: Array  # (7,) rad
    dq: Array  # (7,) rad/s
    pose: Array  # (4, 4) tool in the base
    twist: Array  # (6,) m/s and rad/s in the base
    elbow: tuple[float, float] | None  # rad, sign
    finished: bool

    @classmethod
    def read(cls, packet: bytes) -> Self:
        """Parse one command from a datagram (371 bytes); raises Malformed for any other length."""
        if len(packet) != COMMAND.size:
            raise Malformed(f"a command has {COMMAND.size} bytes, found {len(packet)}")
        (message_id,) = MESSAGE.unpack_from(packet)
        numbers = np.frombuffer(packet, "<f8", COMMAND_NUMBERS, MESSAGE.size)
        with_elbow, finished = packet[FLAGS_OFFSET], packet[FLAGS_OFFSET + 1]
        # on the wire: q_c 7, dq_c 7, O_T_EE_c 16 by columns, O_dP_EE_c 6, elbow_c 2
        return cls(
            message_id,
            numbers[:7],
            numbers[7:14],
            numbers[14:30].reshape(4, 4).T,
            numbers[30:36],
            (float(numbers[36]), float(numbers[37])) if with_elbow else None,
            bool(finished),
        )


def usable(numbers: Array | tuple[float, ...]) -> bool:
    """Whether numbers, of any shape, are finite and within LARGEST_NUMBER."""
    return bool(np.abs(numbers).max() < LARGEST_NUMBER)


def take_request(buffer: bytearray) -> Request | None:
    """Remove the first whole request from the received bytes; None while it is incomplete.

    Raises Malformed for an unknown command or a wrong size.
    """
    if len(buffer) < HEADER.size:
        return None
    number, command_id, size = HEADER.unpack_from(buffer)
    if number not in PAYLOAD:
        raise Malformed(f"command {number} is unknown")
    command = Command(number)
    if size != HEADER.size + PAYLOAD[command]:
        raise Malformed(f"{command.name} of {size} bytes")
    if len(buffer) < size:
        return None
    payload = bytes(buffer[HEADER.size : size])
    del buffer[:size]
    return Request(command, command_id, payload)


def reply(command: Command, command_id: int, content: bytes) -> bytes:
    """Bytes of one reply over TCP; `content` starts with its status."""
    return HEADER.pack(command, command_id, HEADER.size + len(content)) + content
