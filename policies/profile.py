"""Profiles of lifted strips, midlines of a fixed number of points, from simulation and
images.
"""

import numpy as np

from drivers.base.geometry import even_points
from drivers.base.types import Array
from drivers.strip.model import CONTACT_HEIGHT

POINTS = 12  # of a profile that a policy reads, desk contact and gripper included


def profiles(shapes: Array, arc: Array, contact_x: Array, grip: Array) -> Array:
    """Profiles (n, POINTS, 2) [m]: points at equal arc lengths from desk contact to
    gripper.

    Midlines are `shapes` (n, nodes, 2) at arc lengths `arc` (n, nodes) [m]; the strip
    before `contact_x` (n,) lies flat, so that this is also its arc length. The last
    point is the gripper's, `grip` (n, 2).
    """
    fractions = np.linspace(0.0, 1.0, POINTS)
    lifted = arc[:, -1] - contact_x  # m
    wanted = contact_x[:, None] + fractions * lifted[:, None]

    # the last node at or before each point, and the next one
    is_before = arc[:, None, :] <= wanted[:, :, None]
    node = np.clip(is_before.sum(axis=-1) - 1, 0, arc.shape[1] - 2)
    following = node + 1

    strip = np.arange(len(arc))[:, None]
    start = arc[strip, node]
    t = (wanted - start) / (arc[strip, following] - start)
    t = t[..., None]
    points: Array = (1 - t) * shapes[strip, node] + t * shapes[strip, following]
    points[:, -1] = grip
    return points


def image_profile(
    points: Array, contact_x: float, gripper: tuple[float, float]
) -> Array:
    """Profile (1, POINTS, 2) [m] through midline `points` (m, 2) [m] measured in an
    image.

    It begins at the desk contact `contact_x` [m] and ends at the `gripper`'s x, z [m]:
    points of images begin up to 2 mm past the contact, and the fingers hide the last
    ones before the gripper. NaN where nothing was measured.
    """
    if len(points) < 2 or not np.isfinite(contact_x):
        return np.full((1, POINTS, 2), np.nan)
    midline = np.vstack([(contact_x, CONTACT_HEIGHT), points, gripper])
    return even_points(midline, POINTS)[None]
