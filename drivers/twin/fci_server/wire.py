"""Messages of the robot's network protocols, as the emulated robot reads and writes
them.
"""

from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import Any, Generic, Self, TypeVar

import numpy as np

from drivers.base.types import Array
from drivers.franka import hand_protocol
from drivers.franka.hand_protocol import HandCommand, RequestKind

PROTOCOL_VERSION = 10  # of the arm
PORT = 1337
MESSAGE = Struct("<Q")
COMMAND_NUMBERS = 38
# the state that it answers, numbers, flags
COMMAND = Struct(f"<Q{COMMAND_NUMBERS}dBB7dB")
FLAGS_OFFSET = MESSAGE.size + 8 * COMMAND_NUMBERS
LARGEST_NUMBER = 1e6  # in any unit; no command is near it

K = TypeVar("K", bound=RequestKind)


class Command(RequestKind):
    """Requests of a client to the arm over TCP, by their number in the protocol."""

    CONNECT = 0, "HH"  # version, UDP port
    MOVE = 1, "II6dB7d"
    STOP_MOVE = 2
    SET_COLLISION_BEHAVIOR = 3, "52d"
    SET_JOINT_IMPEDANCE = 4, "7d"
    SET_CARTESIAN_IMPEDANCE = 5, "6d"
    SET_GUIDING_MODE = 6, "7B"
    SET_EE_TO_K = 7, "16d"
    SET_NE_TO_EE = 8, "16d"
    SET_LOAD = 9, "13d"
    AUTOMATIC_ERROR_RECOVERY = 10
    GET_ROBOT_MODEL = 11


class Status(IntEnum):
    """Status in a reply to a client's request, other than for a motion."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    INVALID_ARGUMENT = 2


class MoveStatus(IntEnum):
    """Status in the replies to a request for a motion: MOTION_STARTED first, another at
    its end.
    """

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
    """Motion generators, numbered as in the robot's state; in requests numbers are one
    lower.
    """

    IDLE = 0
    JOINT_POSITION = 1
    JOINT_VELOCITY = 2
    CARTESIAN_POSE = 3
    CARTESIAN_VELOCITY = 4
    NONE = 5


class Controller(IntEnum):
    """Controllers of the robot that follow its motion generators, as the protocol
    numbers them.
    """

    JOINT_IMPEDANCE = 0
    CARTESIAN_IMPEDANCE = 1
    EXTERNAL = 2
    OTHER = 3


class RobotMode(IntEnum):
    """Modes of the robot, as numbered in its state."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    RECOVERY = 6


class Reflex(IntEnum):
    """Errors that the robot reports, by the index of their flag among the 41 in the
    state.

    The order is the one in which pylibfranka and franka-rs read the flags; it is not
    that of the public header errors.h.
    """

    JOINT_POSITION_LIMITS_VIOLATION = 0
    CARTESIAN_POSITION_LIMITS_VIOLATION = 1
    SELF_COLLISION_AVOIDANCE_VIOLATION = 2
    JOINT_VELOCITY_VIOLATION = 3
    CARTESIAN_VELOCITY_VIOLATION = 4
    FORCE_CONTROL_SAFETY_VIOLATION = 5
    JOINT_REFLEX = 6
    CARTESIAN_REFLEX = 7
    MAX_GOAL_POSE_DEVIATION_VIOLATION = 8
    MAX_PATH_POSE_DEVIATION_VIOLATION = 9
    CARTESIAN_VELOCITY_PROFILE_SAFETY_VIOLATION = 10
    JOINT_POSITION_MOTION_GENERATOR_START_POSE_INVALID = 11
    JOINT_MOTION_GENERATOR_POSITION_LIMITS_VIOLATION = 12
    JOINT_MOTION_GENERATOR_VELOCITY_LIMITS_VIOLATION = 13
    JOINT_MOTION_GENERATOR_VELOCITY_DISCONTINUITY = 14
    JOINT_MOTION_GENERATOR_ACCELERATION_DISCONTINUITY = 15
    CARTESIAN_POSITION_MOTION_GENERATOR_START_POSE_INVALID = 16
    CARTESIAN_MOTION_GENERATOR_ELBOW_LIMIT_VIOLATION = 17
    CARTESIAN_MOTION_GENERATOR_VELOCITY_LIMITS_VIOLATION = 18
    CARTESIAN_MOTION_GENERATOR_VELOCITY_DISCONTINUITY = 19
    CARTESIAN_MOTION_GENERATOR_ACCELERATION_DISCONTINUITY = 20
    CARTESIAN_MOTION_GENERATOR_ELBOW_SIGN_INCONSISTENT = 21
    CARTESIAN_MOTION_GENERATOR_START_ELBOW_INVALID = 22
    FORCE_CONTROLLER_DESIRED_FORCE_TOLERANCE_VIOLATION = 23
    START_ELBOW_SIGN_INCONSISTENT = 24
    COMMUNICATION_CONSTRAINTS_VIOLATION = 25
    POWER_LIMIT_VIOLATION = 26
    CARTESIAN_MOTION_GENERATOR_JOINT_POSITION_LIMITS_VIOLATION = 27
    CARTESIAN_MOTION_GENERATOR_JOINT_VELOCITY_LIMITS_VIOLATION = 28
    CARTESIAN_MOTION_GENERATOR_JOINT_VELOCITY_DISCONTINUITY = 29
    CARTESIAN_MOTION_GENERATOR_JOINT_ACCELERATION_DISCONTINUITY = 30
    CARTESIAN_POSITION_MOTION_GENERATOR_INVALID_FRAME = 31
    CONTROLLER_TORQUE_DISCONTINUITY = 32
    JOINT_P2P_INSUFFICIENT_TORQUE_FOR_PLANNING = 33
    TAU_J_RANGE_VIOLATION = 34
    INSTABILITY_DETECTED = 35
    JOINT_MOVE_IN_WRONG_DIRECTION = 36
    CARTESIAN_SPLINE_MOTION_GENERATOR_VIOLATION = 37
    JOINT_VIA_MOTION_GENERATOR_PLANNING_JOINT_LIMIT_VIOLATION = 38
    BASE_ACCELERATION_INITIALIZATION_TIMEOUT = 39
    BASE_ACCELERATION_INVALID_READING = 40


class Malformed(Exception):
    """Raised for bytes that are no message of the protocol; the server closes the
    connection.
    """


@dataclass(frozen=True, slots=True)
class ClientRequest(Generic[K]):
    """Request of a client over TCP: command, its id, and a payload of the command's
    length.
    """

    command: K
    command_id: int
    payload: bytes

    @property
    def values(self) -> tuple[Any, ...]:
        """Numbers of the payload, in the order of the command's layout."""
        return self.command.layout.unpack(self.payload)


@dataclass(frozen=True, slots=True)
class Framing(Generic[K]):
    """Layout of a protocol's TCP messages: commands, header, status in replies."""

    commands: type[K]
    header: Struct  # command, command id, size with header
    status: Struct

    def take(self, buffer: bytearray) -> ClientRequest[K] | None:
        """Remove the first request from `buffer` and return it; None while it is
        incomplete.

        Raises Malformed for an unknown command or a wrong size.
        """
        header = self.header
        if len(buffer) < header.size:
            return None

        number, command_id, size = header.unpack_from(buffer)
        if number not in tuple(self.commands):
            raise Malformed(f"command {number} is unknown")

        command = self.commands(number)
        if size != header.size + command.layout.size:
            raise Malformed(f"{command.name} of {size} bytes")
        if len(buffer) < size:
            return None

        payload = bytes(buffer[header.size : size])
        del buffer[:size]
        return ClientRequest(command, command_id, payload)

    def reply(self, command: K, command_id: int, content: bytes) -> bytes:
        """Bytes of a reply to request `command_id` over TCP; `content` starts with its
        status.
        """
        return (
            self.header.pack(command, command_id, self.header.size + len(content))
            + content
        )


@dataclass(frozen=True, slots=True)
class MoveRequest:
    """Request for a motion by `controller` (a Controller) and `generator` (a Generator
    less 1).

    `deviations` (6,) are allowed ones on the path, then at the goal: translation [m],
    rotation and elbow [rad]. `use_async` asks for libfranka's asynchronous motion,
    which is not emulated.
    """

    controller: int
    generator: int
    deviations: tuple[float, ...]
    use_async: bool

    @classmethod
    def read(cls, request: ClientRequest[Command]) -> Self:
        """Parse a client's `request` for a motion."""
        controller, generator, *deviations, use_async = request.values[:9]
        return cls(controller, generator, tuple(deviations), use_async=bool(use_async))


@dataclass(frozen=True, slots=True)
class RobotCommand:
    """Motion command over UDP in answer to state `message_id`: joints, tool pose, or
    rates.
    """

    message_id: int
    q: Array  # (7,) rad
    dq: Array  # (7,) rad/s
    pose: Array  # (4, 4) tool in the base
    twist: Array  # (6,) m/s and rad/s in the base
    elbow: tuple[float, float] | None  # rad, sign
    finished: bool

    @classmethod
    def read(cls, packet: bytes) -> Self:
        """Parse a command from the datagram `packet`; raises Malformed unless it has
        371 bytes.
        """
        if len(packet) != COMMAND.size:
            raise Malformed(f"a command has {COMMAND.size} bytes, found {len(packet)}")
        (message_id,) = MESSAGE.unpack_from(packet)
        numbers = np.frombuffer(packet, "<f8", COMMAND_NUMBERS, MESSAGE.size)
        elbow = (
            (float(numbers[36]), float(numbers[37])) if packet[FLAGS_OFFSET] else None
        )
        # on the wire: q_c 7, dq_c 7, O_T_EE_c 16 by columns, O_dP_EE_c 6, elbow_c 2
        return cls(
            message_id=message_id,
            q=numbers[:7],
            dq=numbers[7:14],
            pose=numbers[14:30].reshape(4, 4).T,
            twist=numbers[30:36],
            elbow=elbow,
            finished=bool(packet[FLAGS_OFFSET + 1]),
        )


def usable(numbers: Array | tuple[float, ...]) -> bool:
    """Whether all of `numbers`, in any shape, are finite and below LARGEST_NUMBER in
    absolute value.
    """
    return bool(np.abs(numbers).max() < LARGEST_NUMBER)


ARM_FRAMING = Framing(Command, header=Struct("<III"), status=Struct("<B"))
HAND_FRAMING = Framing(HandCommand, hand_protocol.HEADER, status=Struct("<H"))
