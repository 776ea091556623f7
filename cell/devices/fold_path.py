"""Path of the gripper through a whole fold, from its home to the retreat."""

from itertools import pairwise

import numpy as np

from cell.config.settings import FoldSettings
from drivers.geometry import arc_lengths
from drivers.installation import MotionLimits
from drivers.types import Array
from policies.path import lift_pitch

LAID_HEIGHT = 0.001  # m of the gripper once the edge lies on the desk
NEAR_EDGE = 0.05  # m beside and above the other edge, where a plain fold ends
LEG_POINTS = 30  # points of either leg of a plain fold


def whole_path(
    length: float,
    home: float,
    fold: FoldSettings,
    limits: MotionLimits,
    carry: Array,
    end: float | None = None,
) -> tuple[Array, Array]:
    """Poses (n, 3) x, z [m], pitch [rad] of a whole fold, and speeds (n,) [m/s] of moves to each.

    From `home` [m] over the edge of a strip of `length` [m]; `carry` (k, 2) leads from the grasped
    edge to where the layers touch. Lay and retreat follow; the edge is laid at `end` [m], or where
    that of a taut layer would be.
    """
    free, fastest = fold.approach, min(limits.x.velocity, limits.z.velocity)
    approach = [(length, home), (length + free, fold.clear_height), (length + free, 2 * free)]
    approach += [(length + free, 0.0), (length, 0.0)]
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
    lay_speeds = [fold.lay_speed] * 2  # of the lowering and the first move of the retreat
    carry_speeds = [fold.speed] * (len(carry) - 1)
    speeds = [fastest] * len(approach) + carry_speeds + [*lay_speeds, fastest, fastest]
    return poses, np.array(speeds)


def triangle(length: float) -> Array:
    """Path (k, 2) [m] of a plain fold: up to the middle of the strip, down to its other edge."""
    corners = np.array([(length, 0.0), (length / 2, length / 2), (NEAR_EDGE, NEAR_EDGE)])
    shares = np.linspace(0.0, 1.0, LEG_POINTS)[:, None]
    up, down = (start + shares * (stop - start) for start, stop in pairwise(corners))
    return np.concatenate([up, down[1:]])


def _with_pitch(points: list[tuple[float, float]], pitch: float) -> Array:
    return np.column_stack([np.array(points), np.full(len(points), pitch)])
