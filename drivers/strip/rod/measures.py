"""Compiled desk contact, fold tip and layer gap, as defined in `drivers.strip.shape`."""

import math
from typing import Any

from drivers.strip.rod.compiled import kernel
from drivers.strip.shape import LYING_LENGTH


@kernel
def desk_contact(x: Any, z: Any, tip: int, height: float) -> Any:
    """x [m] where nodes x, z (n,) [m] rise over `height` [m] to the fold, rightmost at `tip`."""
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
def vertex(left: float, here: float, right: float) -> float:
    """Offset [nodes], at most +-0.5, of the extremum of a parabola through three values."""
    bend = left - 2 * here + right
    if bend == 0:
        return 0.0
    return min(max(0.5 * (left - right) / bend, -0.5), 0.5)


@kernel
def rightmost(x: Any) -> int:
    """Index of the node with the largest x, the first of equals."""
    best = 0
    for j in range(1, len(x)):
        if x[j] > x[best]:
            best = j
    return best


@kernel
def fold_tip(x: Any, z: Any, j: int) -> Any:
    """(x, z) [m] of the rightmost point near node `j`, refined by a parabola."""
    if j in (0, len(x) - 1):
        return x[j], z[j]
    offset = vertex(x[j - 1], x[j], x[j + 1])
    tip_x = x[j] - 0.25 * (x[j - 1] - x[j + 1]) * offset
    slope, bend = 0.5 * (z[j + 1] - z[j - 1]), z[j - 1] - 2 * z[j] + z[j + 1]
    return tip_x, z[j] + offset * slope + 0.5 * offset**2 * bend


@kernel
def gap_over(x: Any, z: Any, j: int, k: int) -> Any:
    """Height [m] of node `j` over the lower layer, infinite without one, and the segment below."""
    if x[j] < x[0]:
        return math.inf, k
    while k > 0 and x[k] > x[j]:
        k -= 1
    while x[k + 1] < x[j]:
        k += 1
    return z[j] - z[k] - (z[k + 1] - z[k]) * (x[j] - x[k]) / (x[k + 1] - x[k]), k


@kernel
def layer_gap(x: Any, z: Any, tip: int, opening: float) -> Any:
    """Height [m] and fractional node index of a fold's narrowest layer gap; infinite if none.

    Counts only local minima after the gap has exceeded `opening` [m].
    """
    last = len(x) - 1
    best, place = math.inf, 0.0
    if last - tip < 3 or tip < 2:  # too few nodes on either side for a fold
        return best, place
    k = tip - 1
    opened, lowest = False, math.inf
    before = 0.0
    here, k = gap_over(x, z, tip, k)
    for j in range(tip, last):
        after, k = gap_over(x, z, j + 1, k)
        opened = opened or here > opening
        if opened and j > tip and here <= before and here < after and here < lowest:
            lowest = here
            best, place = refine_minimum(before, here, after, j)
        before, here = here, after
    return best, place


@kernel
def refine_minimum(before: float, here: float, after: float, j: int) -> Any:
    """Height [m] and node index of a minimum, by a parabola through gaps at j - 1, j and j + 1."""
    if math.isinf(before) or math.isinf(after):
        return here, float(j)
    offset = vertex(before, here, after)
    return here - 0.25 * (before - after) * offset, j + offset


@kernel
def along(values: Any, index: float) -> Any:
    """Linear interpolation of `values` (n,) at a fractional `index`."""
    j = min(int(index), len(values) - 2)
    return values[j] + (values[j + 1] - values[j]) * (index - j)
