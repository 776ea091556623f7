"""Whether the body of the hand stays clear of the desk on which the strip lies."""

import numpy as np

from drivers.types import Array

# Behind the finger tips along the approach axis, and half the thickness there [m]: the palm of the
# Franka Hand at its front and back, and the flange. Source: its data sheet, rounded up.
HAND_BODY = ((0.037, 0.032), (0.07, 0.032), (0.103, 0.05), (0.2, 0.05))
RISE = 0.06  # m that a desk must stand above what is beside it, for a hand that lies flat


def desk_clearance(poses: Array, length: float) -> Array:
    """Height (n,) [m] of the hand's lowest point over the desk for gripper poses (n, 3).

    The desk reaches from x = 0 to `length` [m] and no further: beside it the hand may hang lower.
    Infinite for poses with nothing of the hand over the desk.
    """
    x, z, pitch = poses.T
    lowest = np.full(len(poses), np.inf)
    for behind, half in HAND_BODY:
        for side in (-half, half):
            across = x + behind * np.cos(pitch) - side * np.sin(pitch)
            height = z + behind * np.sin(pitch) + side * np.cos(pitch)
            over = (across > 0) & (across < length)
            lowest = np.where(over, np.minimum(lowest, height), lowest)
    return lowest
