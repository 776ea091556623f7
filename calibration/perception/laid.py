"""Offset between the edges of a laid fold, from the end of its loop."""

import math

# Edge offset minus (length - 2 tip) [m] of folds that lie: the loop holds more strip than it is
# long. Least squares over 60 chains of 80 links, 0.8 mm rms; see `tests.benchmarks.measure_roll`.
ALWAYS, OF_LENGTH, OF_FRICTION = 2.21e-3, -0.743, -1.2e-3
SHORT = 0.75e-3  # m by which images show the tip of a sharp loop too far left, the mean of 4 folds
ROUGH = 10.0  # 1/m, yield curvature


def edge_offset(
    length: float, tip_x: float, bending_length: float, yield_curvature: float
) -> float:
    """Offset of the grasped edge beyond the fixed one [m], with the sign of d.

    For a folded strip of `length` [m] whose loop has its rightmost point at `tip_x` [m]. The layers
    lie flat, so a tip 1 mm to the left leaves 2 mm more for the upper layer; the length in the loop
    follows from `bending_length` [m] and the friction's `yield_curvature` [1/m].
    """
    friction = math.log1p(yield_curvature / ROUGH)
    loop = ALWAYS + OF_LENGTH * bending_length + OF_FRICTION * friction
    return length - 2.0 * (tip_x + SHORT) + loop
