"""Clearance between the body of the hand and the desk on which the strip lies."""

import numpy as np

from drivers.errors import Fault
from drivers.installation import Installation
from drivers.types import Array, Pose

# Behind the finger tips along the approach axis, and half the thickness there [m]: the palm of the
# Franka Hand at its front and back, and the flange. Source: its data sheet, rounded up.
HAND_BODY = ((0.037, 0.032), (0.07, 0.032), (0.103, 0.05), (0.2, 0.05))
RISE = 0.06  # m that a desk must stand above what is beside it, for a hand that lies flat
LEAVING = 1e-4  # m by which a hand that begins inside must not go deeper
WAY_STEPS = 200  # poses on a straight way that are looked at: 5 mm apart at most in a workspace


def desk_end(installation: Installation, length: float | None = None) -> float:
    """x [m] at which the desk ends along the strip: as configured, or the workspace's end.

    A desk that nobody stated ends with a strip of known `length` [m]: no hand could grasp its edge
    otherwise. No desk ends before it.
    """
    stated = installation.desk
    if stated is None:
        return installation.workspace.x[1] if length is None else length
    return max(stated, length or 0.0)


def require_clear(way: list[Pose], end: float) -> None:
    """Raise Fault `hand_meets_desk` for a `way` of the hand into a desk that ends at `end` [m].

    Poses are joined by straight lines; a hand that begins inside may leave.
    """
    corners = np.array([pose.as_array() for pose in way])
    times = np.linspace(0.0, len(way) - 1, WAY_STEPS * (len(way) - 1) + 1)
    poses = np.stack([np.interp(times, np.arange(len(way)), axis) for axis in corners.T], axis=1)
    heights = desk_clearance(poses, end)
    deepest = int(np.argmin(heights))
    if heights[deepest] > min(0.0, heights[0] - LEAVING):
        return
    x, z, pitch = poses[deepest]
    raise Fault(
        "hand_meets_desk",
        f"the hand would come {-1e3 * heights[deepest]:.0f} mm into the desk at x {1e3 * x:.0f}, "
        f"z {1e3 * z:.0f} mm, pitch {np.degrees(pitch):.0f} deg: the desk ends at x "
        f"{1e3 * end:.0f} mm; move higher or further away, or correct installation.desk in "
        "cell.yaml",
    )


def desk_clearance(poses: Array, length: float) -> Array:
    """Height (n,) [m] of the hand's lowest point over the desk for gripper poses (n, 3).

    The desk reaches from x = 0 to `length` [m] and no further: beside it the hand may hang lower.
    Infinite for poses with nothing of the hand over the desk.
    """
    x, z, pitch = poses.T
    lowest = np.full(len(poses), np.inf)
    for behind, half in HAND_BODY:
        for side in (-half, half):
            along = x + behind * np.cos(pitch) - side * np.sin(pitch)
            height = z + behind * np.sin(pitch) + side * np.cos(pitch)
            over = (along > 0) & (along < length)
            lowest = np.where(over, np.minimum(lowest, height), lowest)
    return lowest
