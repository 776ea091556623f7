"""Checks of a robot before the cell moves it: interface version, joint limits, tool."""

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from drivers.base.types import Array
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.inverse_kinematics import rotation_vector
from drivers.franka.kinematics import FLANGE_TO_TIP, pose_from_columns
from drivers.franka.limits import PUBLISHED, JointLimits
from drivers.franka.settings import FciSettings, ToolSettings

PORT = 1337
LIBRARY_VERSION = 10  # of the robot's interface that pylibfranka 0.21 speaks
ANSWER_TIMEOUT = 1.0  # s for each answer
LARGEST_DESCRIPTION = 1 << 20  # bytes of a description
CONNECT, GET_MODEL = 0, 11  # commands
HEADER = struct.Struct("<III")  # command, command id, size with header
CONNECT_MESSAGE = struct.Struct("<IIIHH")  # header, version, UDP port of the client
CONNECT_REPLY = struct.Struct("<BH")  # status, version of the robot
SUCCESS = 0  # status of a reply, its first byte
SLACK = 1e-3  # rad, rad/s, rad/s^2 by which limits may differ from those of the plan

PLACE_TOLERANCE, ANGLE_TOLERANCE = 5e-4, 5e-3  # m and rad by which frames may differ
MASS_TOLERANCE, CENTRE_TOLERANCE = 0.02, 5e-3  # kg and m, likewise
IN_DESK = "set end effector Franka Hand in Desk"
BY_RESET = (
    "see what is mounted; if only the hand is, `cell home --reset-tool` sets it back"
)


def robot_version(address: str) -> int | None:
    """Interface version of the robot at `address`; None where it does not answer.

    A robot that lets the library in speaks its version, whatever else it replies.
    """
    with suppress(OSError), _connection(address) as (_, status, version):
        return LIBRARY_VERSION if status == SUCCESS else version
    return None


def read_description(address: str) -> str | None:
    """URDF description of the robot at `address`; None where the robot sends none.

    To be called before the library connects, which says why a robot refuses: a robot
    serves one client, and pylibfranka does not hand out the text that it reads. Never
    tried on hardware.
    """
    with suppress(OSError), _connection(address) as (link, status, _):
        if status == SUCCESS:
            link.sendall(HEADER.pack(GET_MODEL, 2, HEADER.size))
            reply = _reply(link)
            return reply[1:].decode("utf-8", "replace") if reply[0] == SUCCESS else None
    return None


def joint_limits(settings: FciSettings) -> JointLimits:
    """Joint limits for planning motions: those that the cell's robot describes, or the
    published ones without an answer.

    The latter where the cell has no robot, or none that answers now: one is held to
    them when it connects. Raises ArmFault for another arm than a Franka Research 3.
    """
    address = settings.address
    description = None if address is None else read_description(address)
    if description is None:
        return PUBLISHED[settings.model]
    return JointLimits.from_description(description)


def require_limits(description: str, planned: JointLimits) -> None:
    """Raise ArmFault where a limit in a robot's URDF `description` is not the `planned`
    one.

    Both values are named.
    """
    stated = JointLimits.from_description(description).content()
    differing = [
        f"joint {joint}: {name} is {value:g}, the cell plans with {other:g}"
        for name, plan in planned.content().items()
        for joint, (value, other) in enumerate(
            zip(stated[name], plan, strict=True), start=1
        )
        if not abs(value - other) <= SLACK
    ]
    if differing:
        raise ArmFault(Cause.MODEL, "; ".join(differing))


def require_tool(state: Any, tool: ToolSettings) -> None:
    """Raise ArmFault where tool or load in the robot's `state` differ from the settings
    `tool`.
    """
    differences = list(_tool_differences(state, tool))
    if differences:
        raise ArmFault(Cause.TOOL, "; ".join(differences))


@contextmanager
def _connection(address: str) -> Iterator[tuple[socket.socket, int, int]]:
    """Connect to the arm at `address`; yields socket, reply's status and version, or
    OSError.
    """
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states,
        socket.create_connection((address, PORT), ANSWER_TIMEOUT) as link,
    ):
        states.bind((link.getsockname()[0], 0))
        port = states.getsockname()[1]
        link.sendall(
            CONNECT_MESSAGE.pack(
                CONNECT, 1, CONNECT_MESSAGE.size, LIBRARY_VERSION, port
            )
        )
        reply = _reply(link)
        if len(reply) < CONNECT_REPLY.size:
            raise OSError(f"a reply of {len(reply)} bytes")
        yield link, *CONNECT_REPLY.unpack_from(reply)


def _reply(link: socket.socket) -> bytes:
    """Read a reply's content, without header; OSError if none comes or the reply is too
    long.
    """
    link.settimeout(ANSWER_TIMEOUT)
    _, _, size = HEADER.unpack(_read_exactly(link, HEADER.size))
    if not HEADER.size < size <= LARGEST_DESCRIPTION:
        raise OSError(f"a reply of {size} bytes")
    return _read_exactly(link, size - HEADER.size)


def _read_exactly(link: socket.socket, count: int) -> bytes:
    """Next `count` bytes from `link`; ConnectionResetError where it closes before."""
    content = b""
    while len(content) < count:
        part = link.recv(count - len(content))
        if not part:
            raise ConnectionResetError("it closed the connection")
        content += part
    return content


def _tool_differences(state: Any, tool: ToolSettings) -> Iterator[str]:
    """Yield a text for each difference between the tool in the robot's `state` and
    `tool`.

    NE_T_EE, EE_T_K and the load are set by programs; F_T_NE and the hand's mass in
    Desk.
    """
    set_in_desk = _same_frame(pose_from_columns(state.NE_T_EE), np.eye(4))
    effector_remedy = IN_DESK if set_in_desk else BY_RESET
    frames = (
        ("the end effector (F_T_EE)", state.F_T_EE, FLANGE_TO_TIP, effector_remedy),
        ("the stiffness frame (EE_T_K)", state.EE_T_K, np.eye(4), BY_RESET),
    )
    for quantity, numbers, assumed, remedy in frames:
        frame = pose_from_columns(numbers)
        if not _same_frame(frame, assumed):
            yield _difference(
                quantity, _frame_text(frame), _frame_text(assumed), remedy
            )

    if not abs(state.m_ee - tool.mass) <= MASS_TOLERANCE:
        yield _difference("the hand's mass", _kg(state.m_ee), _kg(tool.mass), IN_DESK)
    if not abs(state.m_load) <= MASS_TOLERANCE:
        yield _difference("the load", _kg(state.m_load), _kg(0.0), BY_RESET)

    centre = np.array(state.F_x_Cee)
    stated = np.array(tool.centre)
    if not np.abs(centre - stated).max() <= CENTRE_TOLERANCE:
        texts = _position_text(centre), _position_text(stated)
        yield _difference("the hand's centre of mass", *texts, IN_DESK)


def _difference(quantity: str, actual: str, assumed: str, remedy: str) -> str:
    return f"{quantity} is {actual}, the cell assumes {assumed}; {remedy}"


def _kg(mass: float) -> str:
    return f"{mass:.2f} kg"


def _same_frame(first: Array, second: Array) -> bool:
    turn = rotation_vector(first[:3, :3] @ second[:3, :3].T)
    apart = np.abs(first[:3, 3] - second[:3, 3]).max()
    # False for NaN
    return bool(apart <= PLACE_TOLERANCE and np.abs(turn).max() <= ANGLE_TOLERANCE)


def _frame_text(frame: Array) -> str:
    turn = np.degrees(np.linalg.norm(rotation_vector(frame[:3, :3])))
    return f"{_position_text(frame[:3, 3])} turned by {turn:.1f} deg"


def _position_text(position: Array) -> str:
    return "(" + ", ".join(f"{1e3 * part:.1f}" for part in position) + ") mm"
