"""Shapes of the Franka Hand, and of desk, clamp and floor about the strip.

All that asks where something is asks here: inverse kinematics' ways, the check of hand
and desk, the lay, the twin's picture, the drawings. Desk and clamp are to be checked by
ruler on the first day.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drivers.base.geometry import EDGE_AHEAD
from drivers.base.installation import Installation
from drivers.base.types import Array

Outline = tuple[tuple[float, float], ...]


def _from_edge(*profile: tuple[float, float]) -> Outline:
    """A `profile` from the middle between the pads, as seen from the held edge."""
    return tuple((behind + EDGE_AHEAD, half) for behind, half in profile)


# The hand: m behind the grip along the approach axis, then to either side along the
# axis on which the fingers open. Source: franka_description, hand.xacro and its meshes,
# rounded up.
FINGER = _from_edge((-0.0090, 0.0145), (0.0265, 0.0255), (0.0450, 0.0265))  # no pad
FINGER_WIDTH = 0.021  # m across
PALM = _from_edge((0.037, 0.104), (0.130, 0.104))
PALM_WIDTH = 0.064  # m across
FLANGE = _from_edge((0.105, 0.05), (0.200, 0.05))
TIP_AHEAD = -FINGER[0][0]  # m by which closed fingers reach beyond the grip

# The cell about the strip, in its frame [m]
DESK_EDGE = 0.3  # to either side of the strip's plane
DESK_DEPTH = 1.0
DESK_START = -0.005  # over this edge the strip goes down to its clamp
CLAMP = (-0.015, -0.06, -0.004)  # of a bar on the desk's end: outside, from, to in z
NOTCH_LENGTH, NOTCH_WIDTH = 0.030, 0.032  # in the desk's other end, for a lower finger
RISE = 0.15  # of the desk above its surroundings, for a hand that lies flat
FLOOR_SIZE = 3.0
ROOM = 0.001  # m that the hand keeps from the lower layer
LEAST_SUPPORT = 0.005  # m of strip on the desk to either side of the notch


@dataclass(frozen=True, slots=True)
class BoxObstacle:
    """Box-shaped obstacle: its `name` and two corners (3,) [m] in the cell's frame."""

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]


# by which a moved camera is seen, beside the fixed end where no hand comes
MARK = BoxObstacle("mark", (-0.030, 0.065, 0.0), (-0.001, 0.095, 0.008))


def grip_problems(width: float) -> Iterator[str]:
    """Yield what keeps the hand from a strip of `width` [m], and what to change."""
    if width < (least := NOTCH_WIDTH + 2 * LEAST_SUPPORT):
        yield (
            f"width: a strip {1e3 * width:.0f} mm wide falls into the desk's notch for"
            f" the lower finger; cut it at least {1e3 * least:.0f} mm wide"
        )


def finger(width: float, side: float) -> Array:
    """Outline (m, 2) [m] of the finger on one `side`, 1 or -1, of hands open by
    `width` [m]: behind the grip, along the opening.
    """
    outer = [(behind, side * (width / 2 + thick)) for behind, thick in FINGER]
    inner = [(behind, side * width / 2) for behind, _ in reversed(FINGER)]
    return np.array([*outer, *inner])


def block(profile: Outline) -> Array:
    """Outline (m, 2) [m] of a part as thick on both sides as its `profile` states."""
    other = [(behind, -half) for behind, half in reversed(profile)]
    return np.array([*profile, *other])


def side_view(outline: Array, poses: Array) -> Array:
    """Corners (n, m, 2) x, z [m] of an `outline` (m, 2) of the hand at gripper `poses`
    (n, 3).
    """
    x, z, pitch = poses.T[..., None]
    behind, side = outline.T
    along = x + behind * np.cos(pitch) - side * np.sin(pitch)
    height = z + behind * np.sin(pitch) + side * np.cos(pitch)
    return np.stack([along, height], axis=-1)


def desk_end(installation: Installation, length: float | None = None) -> float:
    """x [m] at which the desk ends along the strip: as configured, or the workspace's
    end.

    A desk without a configured end ends with a strip of known `length` [m], as no hand
    could grasp the strip's edge otherwise. No desk ends before the strip.
    """
    if installation.desk is None:
        return installation.workspace.x[1] if length is None else length
    return max(installation.desk, length or 0.0)


def boxes(end: float) -> tuple[BoxObstacle, ...]:
    """Desk up to x = `end` [m], with its notch, clamp and floor."""
    outside, low, high = CLAMP
    notch = end - NOTCH_LENGTH
    half = NOTCH_WIDTH / 2
    below = -DESK_DEPTH
    return (
        BoxObstacle("desk", (DESK_START, -DESK_EDGE, below), (notch, DESK_EDGE, 0.0)),
        BoxObstacle(
            "desk beside the notch", (notch, half, below), (end, DESK_EDGE, 0.0)
        ),
        BoxObstacle(
            "desk before the notch", (notch, -DESK_EDGE, below), (end, -half, 0.0)
        ),
        MARK,
        BoxObstacle("clamp", (outside, -DESK_EDGE, low), (DESK_START, DESK_EDGE, high)),
        BoxObstacle(
            "floor",
            (-FLOOR_SIZE, -FLOOR_SIZE, -FLOOR_SIZE),
            (FLOOR_SIZE, FLOOR_SIZE, -RISE),
        ),
    )
