"""Conversion between reported and true gripper poses, which differ by the errors in `Rig`.

The strip is grasped as it lies on the desk, so offsets, tilt and desk height act from 0 upwards
over the first `LIFT_TRAVEL` of the path, in proportion to the largest distance from its start.
Heights of true poses are measured from the true desk.

A strip that already hangs at the start of the path has the full offsets. Without effects of the rig
the arrays are returned unchanged.
"""

import numpy as np

from drivers.strip.model import Rig
from drivers.types import Array

LIFT_TRAVEL = 0.10  # m of path over which a lift turns the pitch from flat to hanging
AS_REPORTED = Rig()


def true_path(rig: Rig, t: Array, poses: Array, *, hanging: bool = False) -> tuple[Array, Array]:
    """True times (m,) [s] and poses (m, 3) of a gripper path reported as `t`, `poses`.

    A strip that hangs when the path begins has its lift behind it. Without effects of the rig
    the arrays are returned unchanged.
    """
    if rig == AS_REPORTED:
        return t, poses
    share = np.ones(len(poses)) if hanging else growth(poses)
    return t - rig.delay, true_poses(rig, poses, share)


def growth(poses: Array) -> Array:
    """Fraction (m,) of the rig's offsets that acts along reported `poses` (m, 3).

    It never decreases: a gripper that returns keeps the largest fraction so far.
    """
    return np.maximum.accumulate(share_away(poses, poses[0]))


def share_away(poses: Array, start: Array) -> Array:
    """Fraction (...,) of the rig's offsets that acts at reported `poses` (..., 3).

    It grows with the distance from `start` (3,), the pose of the grasp.
    """
    away = np.hypot(poses[..., 0] - start[0], poses[..., 1] - start[1])
    return np.asarray(np.minimum(away / LIFT_TRAVEL, 1.0))


def true_poses(rig: Rig, reported: Array, share: Array | float) -> Array:
    """True poses (..., 3) over the true desk: `reported` plus `share` (...) of the offsets."""
    return np.asarray(reported + _offset(rig) * np.asarray(share)[..., None])


def reported_poses(rig: Rig, true: Array, share: Array | float) -> Array:
    """Reported poses (..., 3) of `true` ones (..., 3); the inverse of `true_poses`."""
    return np.asarray(true - _offset(rig) * np.asarray(share)[..., None])


def _offset(rig: Rig) -> Array:
    """Offset (3,) [m, m, rad] of the true pose over the true desk from the reported one."""
    return np.array([rig.grip_x, rig.grip_z - rig.desk_height, rig.grip_tilt])
