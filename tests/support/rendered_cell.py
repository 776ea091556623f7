"""Strip shapes and scenes for tests and benchmark of the renderer."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.base.geometry import arc_lengths
from drivers.base.readers import read_yaml
from drivers.base.types import Array, Pose
from drivers.twin.world import WorldState

LENGTH, NODES = 0.6, 601
KNOTS: dict[str, tuple[list[float], list[float]]]
KNOTS = read_yaml(Path(__file__).with_suffix(".yaml"))


def midline(kind: str) -> tuple[Array, Array]:
    """Nodes (n, 2) [m] and their arc lengths (n,) of a strip whose tangent angle is
    given.
    """
    step = LENGTH / (NODES - 1)
    s = (np.arange(NODES - 1) + 0.5) * step
    angle = np.interp(s, *KNOTS[kind])
    steps = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * step
    points = np.concatenate([[(0.0, 0.0)], np.cumsum(steps, axis=0)])
    return points, np.arange(NODES) * step


def scene(
    kind: str, stamp: float = 0.0, shift: tuple[float, float] = (0.0, 0.0)
) -> WorldState:
    """Scene of a held strip of a `kind` of shape, its grasped edge moved by `shift`
    [m].
    """
    points, arc = midline(kind)
    points = points + (arc / LENGTH)[:, None] * np.array(shift)
    dx, dz = points[-1] - points[-2]
    pose = Pose(float(points[-1, 0]), float(points[-1, 1]), float(np.arctan2(dz, dx)))
    return WorldState(stamp, points, arc, pose, finger_width=0.001, holds_strip=True)


def lying(points: Array, gripper: Pose, *, strip: bool = True) -> WorldState:
    """Scene of a strip along `points` (n, 2) [m] that nobody holds, or of none."""
    arc = arc_lengths(points)
    return WorldState(0.0, points, arc, gripper, 0.04, holds_strip=False, strip=strip)


def flat(length: float = LENGTH) -> Array:
    """Points (61, 2) [m] of a strip that lies flat."""
    return np.linspace((0.0, 0.0), (length, 0.0), 61)


def empty(pose: Pose, *, pointer: bool = False) -> WorldState:
    """Scene without a strip, with the closed hand at `pose`."""
    scene = lying(flat(), pose, strip=False)
    return replace(scene, finger_width=0.0, pointer=pointer)
