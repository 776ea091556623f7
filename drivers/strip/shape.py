"""Geometric features of a strip's shape: desk contact, fold tip, layer gap and layer
touch.

Both engines, policies and perception use these definitions. A shape is the midline as
nodes (n, 2) of x, z [m] in the cell frame at arc lengths s (n,) [m] from the fixed
edge.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from drivers.base.jit import entry, kernel
from drivers.base.types import Array

LYING_LENGTH = 0.05  # m of lying strip that ends the search for the desk contact
# nodes before the fold's rightmost one, and from it on: fewer are no fold
SHORTEST_LAYERS = 2, 4


class LayerGap(NamedTuple):
    """Smallest vertical gap `height` [m] of a fold's layers, at `x` [m] and arc length
    `s` [m].
    """

    height: float
    x: float
    s: float


NO_GAP = LayerGap(math.inf, math.nan, math.nan)


def desk_contact(points: Array, height: float) -> float:
    """x [m] of the desk contact: where the midline `points` (n, 2) [m] rises above
    `height` [m] towards the fold.

    Searched from the fold's rightmost point back to where the strip lies for
    LYING_LENGTH, or to the fixed edge. So neither ripples that friction leaves in the
    lying strip count, nor a dip behind the buckle of a lift. For a strip that lies
    entirely it is the x of its grasped end.
    """
    return float(_features_of(points, height=height)[0])


def fold_tip(points: Array) -> tuple[float, float]:
    """x, z [m] of the fold's tip, the rightmost point of the midline `points` (n, 2)
    [m], refined by a parabola.
    """
    _, x, z, *_ = _features_of(points)
    return float(x), float(z)


def layer_gap(points: Array, s: Array, opening: float) -> LayerGap | None:
    """Smallest vertical gap between the upper and lower layer of a folding strip's
    midline; None before there is a fold.

    `points` are (n, 2), `s` (n,) their arc lengths [m]. The upper layer runs from the
    fold's rightmost point to the grasped edge. Near that point both layers meet by
    definition, so the gap counts from where it first exceeds `opening` [m], and only
    once it has begun to close again: at a node that is a local minimum.
    """
    *_, height, index = _features_of(points, opening=opening)
    if math.isinf(height):
        return None
    nodes = np.arange(len(s))
    return LayerGap(
        height,
        *(float(np.interp(index, nodes, values)) for values in (points[:, 0], s)),
    )


def _features_of(points: Array, height: float = 0.0, opening: float = math.inf) -> Any:
    """Desk contact, fold tip and layer gap of a midline `points` (n, 2) [m], as five
    numbers.
    """
    x, z = np.array(points.T, dtype=np.float64, order="C")
    return features(x, z, height, opening)


@entry
def features(x: Any, z: Any, height: float, opening: float) -> Any:
    """Desk contact, fold tip and layer gap of the midline `x`, `z` (n,) [m], as five
    numbers.

    x [m] of the desk contact at `height` [m]; x, z [m] of the fold's tip; height [m]
    and fractional node index of the layer gap after it has exceeded `opening` [m],
    infinite without one.
    """
    tip = _rightmost(x)
    tip_x, tip_z = _refine_tip(x, z, tip)
    gap, index = _narrowest_gap(x, z, tip, opening)
    return _contact_before(x, z, tip, height), tip_x, tip_z, gap, index


@entry
def layer_touch(before: Any, now: Any, limit: float) -> Any:
    """Fraction of a time step after which a fold's layers touch, and x and arc length
    [m] of the touch.

    `before` and `now` are height, x and arc length [m] of the layer gap at the
    beginning of the step and at its end, where the height is at most `limit` [m].
    Linear between both; at the end of the step where the gap was not above the limit
    before.
    """
    height, x, s = now
    if not (math.isfinite(before[0]) and before[0] > limit):
        return 1.0, x, s
    fraction = (before[0] - limit) / (before[0] - height)
    return (
        fraction,
        before[1] + fraction * (x - before[1]),
        before[2] + fraction * (s - before[2]),
    )


@kernel
def at_index(values: Any, index: float) -> Any:
    """Value at a fractional `index` of `values` (n,), interpolated linearly."""
    j = min(int(index), len(values) - 2)
    return values[j] + (values[j + 1] - values[j]) * (index - j)


@kernel
def _contact_before(x: Any, z: Any, tip: int, height: float) -> Any:
    """x [m] of the desk contact: where nodes x, z (n,) [m] rise above `height` [m]
    before the rightmost node `tip`.
    """
    last = len(x) - 1
    j = tip
    if z[tip] <= height:
        while j < last and z[j + 1] <= height:
            j += 1
        if j == last:
            return x[last]

    while j >= 0:
        if z[j] <= height:
            k = j
            while k > 0 and z[k - 1] <= height:
                k -= 1
            if k == 0 or x[j] - x[k] >= LYING_LENGTH:
                return x[j] + (x[j + 1] - x[j]) * (height - z[j]) / (z[j + 1] - z[j])
            j = k
        j -= 1
    return x[0]


@kernel
def _vertex(left: float, middle: float, right: float) -> float:
    """Offset from the middle of three equally spaced values, in nodes and at most
    +-0.5, of the vertex of the parabola through them.
    """
    bend = left - 2 * middle + right
    if bend == 0:
        return 0.0
    return min(max(0.5 * (left - right) / bend, -0.5), 0.5)


@kernel
def _rightmost(x: Any) -> int:
    """Index of the first node with the largest of `x` (n,)."""
    best = 0
    for j in range(1, len(x)):
        if x[j] > x[best]:
            best = j
    return best


@kernel
def _refine_tip(x: Any, z: Any, j: int) -> Any:
    """x, z [m] of a midline's rightmost point near its node `j`, by a parabola through
    three nodes.
    """
    if j in (0, len(x) - 1):
        return x[j], z[j]
    offset = _vertex(x[j - 1], x[j], x[j + 1])
    tip_x = x[j] - 0.25 * (x[j - 1] - x[j + 1]) * offset

    # z at the vertex of x, by a parabola as well
    slope = 0.5 * (z[j + 1] - z[j - 1])
    bend = z[j - 1] - 2 * z[j] + z[j + 1]
    tip_z = z[j] + offset * slope + 0.5 * offset**2 * bend
    return tip_x, tip_z


@kernel
def _height_over_lower_layer(x: Any, z: Any, j: int, k: int) -> Any:
    """Height [m] of node `j` above the fold's lower layer, infinite where none lies
    below it, and the segment `k` below it.
    """
    if x[j] < x[0]:
        return math.inf, k
    while k > 0 and x[k] > x[j]:
        k -= 1
    while x[k + 1] < x[j]:
        k += 1
    return z[j] - ((z[k + 1] - z[k]) / (x[k + 1] - x[k]) * (x[j] - x[k]) + z[k]), k


@kernel
def _narrowest_gap(x: Any, z: Any, tip: int, opening: float) -> Any:
    """Height [m] (infinite for none) and fractional node index of the narrowest gap
    between a fold's layers.
    """
    last = len(x) - 1
    best = math.inf
    position = 0.0
    if tip < SHORTEST_LAYERS[0] or last - tip + 1 < SHORTEST_LAYERS[1]:
        return best, position

    opened = False
    lowest = math.inf
    last_gap = 0.0
    gap, k = _height_over_lower_layer(x, z, tip, tip - 1)

    for j in range(tip, last):
        next_gap, k = _height_over_lower_layer(x, z, j + 1, k)
        opened = opened or gap > opening
        if opened and j > tip and gap <= last_gap and gap < next_gap and gap < lowest:
            lowest = gap
            best, position = _refine_minimum(last_gap, gap, next_gap, j)
        last_gap, gap = gap, next_gap

    return best, position


@kernel
def _refine_minimum(before: float, middle: float, after: float, j: int) -> Any:
    """Height [m] and fractional node index of the layer gap's minimum, by a parabola
    through the gaps at nodes j - 1, j and j + 1.
    """
    if math.isinf(before) or math.isinf(after):
        return middle, float(j)
    offset = _vertex(before, middle, after)
    return middle - 0.25 * (before - after) * offset, j + offset
