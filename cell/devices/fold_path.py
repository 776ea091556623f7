"""Path of the gripper through a whole fold, from its home to the retreat."""

from itertools import pairwise

import numpy as np

from cell.config.settings import FoldSettings
from drivers.geometry import arc_lengths
from drivers.installation import Installation, MotionLimits
from drivers.types import Array
from policies.path import Path, lift_pitch

LAID_HEIGHT = 0.001  # m, height of the gripper when the edge lies on the desk
NEAR_EDGE = 0.05  # m beside and above the other edge, where a plain fold ends
LEG_POINTS = 30  # points of either leg of a plain fold
CORNER = 0.05  # m of a path over which an arm may round a corner: 9 mm inside a right angle
TURNING = 2.4  # rad/s, rotation of the hand in a fold, a little below an arm's limit
LEAST_NEED = 1e-9  # least derivative of a path counted, so that no limit is divided by 0


def whole_path(
    length: float,
    installation: Installation,
    fold: FoldSettings,
    carry: Array,
    end: float | None = None,
) -> tuple[Array, Array]:
    """Poses (n, 3) x, z [m], pitch [rad] of a fold, and speeds (n,) [m/s] of the moves to each.

    From the home over the edge of a strip of `length` [m]; `carry` (k, 2) leads from the grasped
    edge to where the layers touch. Lay and retreat follow; the edge is laid at `end` [m], or where
    that of a taut layer would be.
    """
    free = fold.approach
    beyond = length + free
    approach = [(length, installation.home_height), (beyond, fold.clear_height), (beyond, 2 * free)]
    approach += [(beyond, 0.0), (length, 0.0)]
    carried = np.column_stack([carry, lift_pitch(arc_lengths(carry))])
    x, z = carry[-1].tolist()
    end = max(x - z, 0.0) if end is None else end
    above = min(fold.lay_height, z)
    # the hand turns with the square of its progress on the lay path, as in orchestrator.lay
    progress = 1.0 - above / (np.hypot(x - end, z - above) + above)
    lowering = [(end, above, np.pi / 2 * (1.0 + progress**2))]
    retreat = [(end, LAID_HEIGHT), (end - free, LAID_HEIGHT), (end - free, 2 * free)]
    poses = np.concatenate(
        [_with_pitch(approach, 0.0), carried[1:], lowering, _with_pitch(retreat, np.pi)]
    )
    limits = installation.limits
    fastest = min(limits.x.velocity, limits.z.velocity)
    lay_speeds = [fold.lay_speed] * 2  # of the lowering and the first move of the retreat
    carry_speeds = [fold.speed] * (len(carry) - 1)
    speeds = [fastest] * len(approach) + carry_speeds + [*lay_speeds, fastest, fastest]
    return poses, np.array(speeds)


def triangle(length: float) -> Array:
    """Path (k, 2) [m] of a plain fold: up over the strip's middle, down to its other edge."""
    corners = np.array([(length, 0.0), (length / 2, length / 2), (NEAR_EDGE, NEAR_EDGE)])
    shares = np.linspace(0.0, 1.0, LEG_POINTS)[:, None]
    up, down = (start + shares * (stop - start) for start, stop in pairwise(corners))
    return np.concatenate([up, down[1:]])


def largest_speed(points: Array, limits: MotionLimits) -> float:
    """Largest speed [m/s] at which an arm within `limits` follows the path `points` (n, 2) [m].

    At a constant speed v, the first, second and third derivative of the path by its length, times
    v, v^2 and v^3, are the velocity, acceleration and jerk that it asks of each axis; here as
    differences over steps of CORNER. Of the pitch only the velocity counts, where an arm does not
    allow TURNING.
    """
    path = Path.through(points)
    turning = limits.pitch.velocity
    poses = path.poses(np.arange(0.0, path.length, CORNER))
    allowed = [
        [limits.x.velocity, limits.z.velocity, turning if turning < TURNING else np.inf],
        [axis.acceleration for axis in limits.axes[:2]],
        [axis.jerk for axis in limits.axes[:2]],
    ]
    speeds = []
    for order, most in enumerate(allowed, 1):
        needed = np.abs(np.diff(poses, order, axis=0)).max(axis=0, initial=0.0) / CORNER**order
        shares = np.array(most) / np.maximum(needed[: len(most)], LEAST_NEED)
        speeds.append(float(shares.min()) ** (1.0 / order))
    return float(min(speeds))


def _with_pitch(points: list[tuple[float, float]], pitch: float) -> Array:
    """Poses (n, 3) x, z [m], pitch [rad] at `points`, all with the same `pitch`."""
    return np.column_stack([np.array(points), np.full(len(points), pitch)])
