"""The robot's own description of its joints, read before the library connects."""

import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from xml.etree import ElementTree

import numpy as np

from drivers.arm.failure import Cause, Failed, Failure
from drivers.franka import limits

PORT = 1337
LIBRARY_VERSION = 10  # of the robot's interface that pylibfranka 0.21 speaks
ANSWER_TIMEOUT = 1.0  # s for each answer
LARGEST_DESCRIPTION = 1 << 20  # bytes of a description
CONNECT, GET_MODEL = 0, 11  # commands
HEADER = struct.Struct("<III")  # command, command id, size with header
CONNECT_MESSAGE = struct.Struct("<IIIHH")  # header, version, UDP port of the client
SUCCESS = b"\0"  # first byte of a reply
SLACK = 1e-3  # rad, rad/s, rad/s^2 by which a limit may be narrower than the cell's

# Attribute of the description, what the cell assumes (7,), and whether the robot's must reach it
# from below (+1: at least so large) or from above (-1: at most so large).
ASSUMED_LIMITS = (
    ("limit", "lower", limits.POSITION_LOW, -1),
    ("limit", "upper", limits.POSITION_HIGH, 1),
    ("limit", "velocity", limits.VELOCITY, 1),
    ("position_based_velocity_limits", "velocity_offset", limits.VELOCITY_OFFSET, -1),
    ("position_based_velocity_limits", "deceleration_limit", limits.DECELERATION, 1),
)


def read_description(address: str) -> str | None:
    """URDF text of the robot at `address`; None where the robot gives none.

    The library then says why. A connection of its own, before the library's: a robot serves one
    client, and pylibfranka keeps the text that it reads to itself. Never tried on hardware.
    """
    with (
        suppress(OSError),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states,
        socket.create_connection((address, PORT), ANSWER_TIMEOUT) as link,
    ):
        states.bind((link.getsockname()[0], 0))
        port = states.getsockname()[1]
        link.sendall(CONNECT_MESSAGE.pack(CONNECT, 1, CONNECT_MESSAGE.size, LIBRARY_VERSION, port))
        if _reply(link)[:1] == SUCCESS:
            link.sendall(HEADER.pack(GET_MODEL, 2, HEADER.size))
            reply = _reply(link)
            return reply[1:].decode("utf-8", "replace") if reply[:1] == SUCCESS else None
    return None


def require_limits(description: str) -> None:
    """Raise Failed where a joint of this robot allows less than the cell plans with.

    Both values are named. The format is that of franka_description.
    """
    if "<!" in description.replace("<!--", ""):
        raise Failed(Failure(Cause.MODEL, "the robot's description declares entities"))
    try:
        root = ElementTree.fromstring(description)  # noqa: S314  no entities: refused above
    except ElementTree.ParseError as error:
        raise Failed(Failure(Cause.MODEL, f"the robot's description is no XML: {error}")) from None
    joints = {joint.get("name", "").rpartition("joint")[2]: joint for joint in root.iter("joint")}
    narrower = list(_narrower_limits(joints))
    if narrower:
        raise Failed(Failure(Cause.MODEL, "; ".join(narrower)))


def _narrower_limits(joints: dict[str, ElementTree.Element]) -> Iterator[str]:
    """Yield a text for each limit of `joints` that is narrower than the cell assumes."""
    for number in range(7):
        for tag, name, wanted, sign in ASSUMED_LIMITS:
            value, planned = _value(joints, number, tag, name), wanted[number]
            if not sign * (value - planned) >= -SLACK:  # true for NaN
                yield f"joint {number + 1}: {name} is {value:g}, the cell plans with {planned:g}"


def _value(joints: dict[str, ElementTree.Element], number: int, tag: str, name: str) -> float:
    """Attribute `name` of a joint's `tag`; NaN, which no limit allows, where it is missing."""
    joint = joints.get(str(number + 1))
    element = None if joint is None else joint.find(tag)
    try:
        return float("nan" if element is None else element.get(name, "nan"))
    except ValueError:
        return float(np.nan)


def _reply(link: socket.socket) -> bytes:
    """Content of the next reply; OSError where it does not come or is too long."""
    link.settimeout(ANSWER_TIMEOUT)
    _, _, size = HEADER.unpack(_read_exactly(link, HEADER.size))
    if not HEADER.size < size <= LARGEST_DESCRIPTION:
        raise OSError(f"a reply of {size} bytes")
    return _read_exactly(link, size - HEADER.size)


def _read_exactly(link: socket.socket, count: int) -> bytes:
    content = b""
    while len(content) < count:
        more = link.recv(count - len(content))
        if not more:
            raise ConnectionResetError("it closed the connection")
        content += more
    return content
