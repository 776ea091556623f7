"""Forces of moving air on the links of a chain."""

import numpy as np

from drivers.twin.chain.forces import Parts
from drivers.twin.chain.joints import Joints
from drivers.types import Array

TINY = 1e-6  # s, over which nodes are led on to see how fast they move
LEAST_SPEED = 1e-9  # m/s, in place of a speed of zero where one divides by it


def link_motion(joints: Joints, position: Array, rate: Array) -> tuple[Array, Array, Array]:
    """Midpoints (n, 2) [m] of the links, their velocities (n, 2) [m/s] and directions (n, 2)."""
    nodes = joints.nodes(position)
    speed = (joints.nodes(position + TINY * rate) - nodes) / TINY
    along = np.diff(nodes, axis=0)
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    return 0.5 * (nodes[1:] + nodes[:-1]), 0.5 * (speed[1:] + speed[:-1]), along


def drag_step(parts: Parts, force: Array, speed: Array, h: float) -> Array:
    """Drag `force` (n, 2) at velocity `speed` (n, 2) [m/s], reduced as by an implicit step `h` [s].

    Each link is stepped alone. Without this light strips are thrown back and forth.
    """
    size = np.hypot(force[:, 0], force[:, 1])
    slope = 2.0 * size / np.maximum(np.hypot(speed[:, 0], speed[:, 1]), LEAST_SPEED)  # of v^2
    return np.asarray(force / (1.0 + h * slope / parts.lumps.mass)[:, None])
