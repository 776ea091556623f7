"""Path of the gripper through a whole fold, from its home to the retreat."""

from itertools import pairwise

import numpy as np

from cell.config.fold import FoldSettings
from drivers.geometry import arc_lengths
from drivers.limits import MotionLimits
from drivers.types import Array
from policies.path import lift_pitch


def whole_path(
    length: float,
    home: float,
    fold: FoldSettings,
    limits: MotionLimits,
    carry: Array,
    end: float | None = None,
) -> tuple[Array, Array]:
    """Poses (n, 3) of x, z [m], pitch [rad], and the speeds (n,) [m/s] of the moves to them.

    From `home` [m] over the edge of a strip of `length` [m]; `carry` (k, 2) leads from the grasped
    edge to where the layers touch. Lay and retreat follow; the edge is laid at `end` [m], or where
    that of a taut layer would be.
    """
    away, quick = fold.approach, min(limits.x.velocity, limits.z.velocity)
    comes = [(length, home), (length + away, fold.clear_height), (length + away, 2 * away)]
    comes += [(length + away, 0.0), (length, 0.0)]
    travel = arc_lengths(carry)
    carried = np.column_stack([carry, lift_pitch(travel)])
    x, z = carry[-1].tolist()
    end = max(x - z, 0.0) if end is None else end
    above = min(fold.lay_height, z)
    share = 1.0 - above / (np.hypot(x - end, z - above) + above)
    lid = [(end, above, np.pi / 2 * (1.0 + share**2))]
    goes = [(end, 0.001), (end - away, 0.001), (end - away, 2 * away)]
    poses = np.concatenate([_with_pitch(comes, 0.0), carried[1:], lid, _with_pitch(goes, np.pi)])
    laid = [fold.lay_speed] * 2
    speeds = [quick] * len(comes) + [fold.speed] * (len(carry) - 1) + [*laid, quick, quick]
    return poses, np.array(speeds)


def triangle(length: float) -> Array:
    """Path (k, 2) [m] of a plain fold: up to the middle and down to the other edge."""
    corners = np.array([(length, 0.0), (length / 2, length / 2), (0.05, 0.05)])
    shares = np.linspace(0.0, 1.0, 30)[:, None]
    legs = [a + shares * (b - a) for a, b in pairwise(corners)]
    return np.concatenate([legs[0], legs[1][1:]])


def _with_pitch(points: list[tuple[float, float]], pitch: float) -> Array:
    return np.column_stack([np.array(points), np.full(len(points), pitch)])
