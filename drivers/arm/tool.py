"""Compares the tool that a robot is configured for with the one that the cell assumes."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.arm.failure import Cause, Failed, Failure
from drivers.arm.settings import ToolSettings
from drivers.franka.kinematics import FLANGE_TO_TIP
from drivers.franka.tracking import rotation_vector
from drivers.types import Array

PLACE_TOLERANCE, ANGLE_TOLERANCE = 5e-4, 5e-3  # m and rad by which frames may differ
MASS_TOLERANCE, CENTRE_TOLERANCE = 0.02, 5e-3  # kg and m, likewise
IDENTITY = np.eye(4).ravel().tolist()
IN_DESK = "set end effector Franka Hand in Desk"
BY_RESET = "see what is mounted; if only the hand is, `cell home --reset-tool` sets it back"


@dataclass(frozen=True, slots=True)
class Difference:
    """One property of the robot's tool that differs from the cell's, and the `remedy`, as texts."""

    what: str
    found: str
    expected: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.what} is {self.found}, the cell assumes {self.expected}; {self.remedy}"


def tool_differences(state: Any, tool: ToolSettings) -> list[Difference]:
    """Properties in which the tool in the robot's `state` differs from the Franka Hand and `tool`.

    Left by another program are NE_T_EE, EE_T_K and the load; F_T_NE and the hand's mass are Desk's.
    """
    frames = [
        ("the end effector (F_T_EE)", state.F_T_EE, FLANGE_TO_TIP, _remedy(state)),
        ("the stiffness frame (EE_T_K)", state.EE_T_K, np.eye(4), BY_RESET),
    ]
    found = [
        Difference(what, _frame_text(_matrix(numbers)), _frame_text(wanted), remedy)
        for what, numbers, wanted, remedy in frames
        if not _same_frame(_matrix(numbers), wanted)
    ]
    masses = [
        ("the hand's mass", state.m_ee, tool.mass, IN_DESK),
        ("the load", state.m_load, 0.0, BY_RESET),
    ]
    found += [
        Difference(what, f"{mass:.2f} kg", f"{stated:.2f} kg", remedy)
        for what, mass, stated, remedy in masses
        if not abs(mass - stated) <= MASS_TOLERANCE
    ]
    off = np.abs(np.array(state.F_x_Cee) - tool.centre).max()
    if not off <= CENTRE_TOLERANCE:
        here, wanted = (_place_text(np.array(place)) for place in (state.F_x_Cee, tool.centre))
        found.append(Difference("the hand's centre of mass", here, wanted, IN_DESK))
    return found


def require_tool(state: Any, tool: ToolSettings) -> None:
    """Raise Failed, with both values and the remedy, for a tool that is not the cell's."""
    found = tool_differences(state, tool)
    if found:
        raise Failed(Failure(Cause.TOOL, "; ".join(map(str, found))))


def _remedy(state: Any) -> str:
    """Remedy for a wrong end effector, by whether Desk or another client set it."""
    return IN_DESK if _same_frame(_matrix(state.NE_T_EE), np.eye(4)) else BY_RESET


def _matrix(columns: Any) -> Array:
    return np.reshape(np.array(columns, dtype=np.float64), (4, 4)).T


def _same_frame(one: Array, other: Array) -> bool:
    turn = rotation_vector(one[:3, :3] @ other[:3, :3].T)
    apart = np.abs(one[:3, 3] - other[:3, 3]).max()
    return bool(apart <= PLACE_TOLERANCE and np.abs(turn).max() <= ANGLE_TOLERANCE)  # False for NaN


def _frame_text(frame: Array) -> str:
    turn = np.degrees(np.linalg.norm(rotation_vector(frame[:3, :3])))
    return f"{_place_text(frame[:3, 3])} turned by {turn:.1f} deg"


def _place_text(place: Array) -> str:
    return "(" + ", ".join(f"{1e3 * part:.1f}" for part in place) + ") mm"
