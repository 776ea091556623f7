"""Geometric features of a strip's shape: desk contact, fold tip, layer gap and layer touch.

One definition for truth, both engines, policies and perception. A shape is the midline as nodes (n,
2) of x, z [m] in the cell frame at arc lengths s (n,) [m] from the fixed edge.
"""

from dataclasses import dataclass

import numpy as np

from drivers.types import Array

LYING_LENGTH = 0.05  # m of strip that lies, which ends the search for the desk contact


@dataclass(frozen=True, slots=True)
class Touch:
    """First touch of the layers: its time [s], its x [m], and the lengths [m] to both edges."""

    time: float
    x: float
    to_grasped: float
    to_fixed: float

    @property
    def displacement(self) -> float:
        """Misalignment d = l1 - l2 [m] of the layers (paper, figure of l1 and l2)."""
        return self.to_grasped - self.to_fixed


@dataclass(frozen=True, slots=True)
class Gap:
    """Smallest vertical distance `height` [m] of the layers, at `x` [m] and arc length `s` [m]."""

    height: float
    x: float
    s: float


def desk_contact(points: Array, height: float) -> float:
    """x [m] where the midline `points` (n, 2) leaves the desk for the fold, `height` [m] over rest.

    Searched from the fold's rightmost point back to where the strip lies: for `LYING_LENGTH`, or to
    the fixed edge. So neither ripples that friction leaves in the lying strip count, nor a dip
    behind the buckle of a lift. Where the whole strip lies it is the x of its grasped end.
    """
    tip = int(np.argmax(points[:, 0]))
    if points[tip, 1] <= height:
        tip = _last_low(points[:, 1], tip, height)
        if tip == len(points) - 1:
            return float(points[-1, 0])
    low = points[: tip + 1, 1] <= height
    ends = np.flatnonzero(low[:-1] & ~low[1:]).tolist()
    if low[tip]:
        ends.append(tip)
    for j in reversed(ends):
        above = np.flatnonzero(~low[:j])
        begin = int(above[-1]) + 1 if len(above) else 0
        if begin == 0 or points[j, 0] - points[begin, 0] >= LYING_LENGTH:
            (xa, za), (xb, zb) = points[j], points[j + 1]
            return float(xa + (xb - xa) * (height - za) / (zb - za))
    return float(points[0, 0])


def _last_low(z: Array, start: int, height: float) -> int:
    """Last index of the run of values `z` (n,) at most `height` that begins at `start`."""
    above = np.flatnonzero(z[start:] > height)
    return start + int(above[0]) - 1 if len(above) else len(z) - 1


def fold_tip(points: Array) -> tuple[float, float]:
    """(x, z) [m] of the rightmost point of `points` (n, 2), refined by a parabola."""
    j = int(np.argmax(points[:, 0]))
    if j in (0, len(points) - 1):
        return float(points[j, 0]), float(points[j, 1])
    left, here, right = points[j - 1], points[j], points[j + 1]
    offset = _vertex(left[0], here[0], right[0])
    x = here[0] - 0.25 * (left[0] - right[0]) * offset
    z = (
        here[1]
        + 0.5 * offset * (right[1] - left[1])
        + 0.5 * offset**2 * (left[1] - 2 * here[1] + right[1])
    )
    return float(x), float(z)


def layer_gap(points: Array, s: Array, opening: float) -> Gap | None:
    """Smallest vertical gap of the upper layer over the lower one, or None before a fold.

    `points` are (n, 2), `s` (n,) their arc lengths [m]. The upper layer runs from the fold's
    rightmost point to the grasped edge. Near that point both layers meet by definition, so the gap
    counts from where it first exceeds `opening` [m], and only once it has begun to close again: at
    a node that is a local minimum.
    """
    tip = int(np.argmax(points[:, 0]))
    upper = points[tip:]
    if len(upper) < 4 or tip < 2:  # too few nodes on either side for a fold
        return None
    lower_z = np.interp(upper[:, 0], points[: tip + 1, 0], points[: tip + 1, 1])
    gap = np.where(upper[:, 0] >= points[0, 0], upper[:, 1] - lower_z, np.inf)
    j = _closing_minimum(gap, opening)
    if j is None:
        return None
    if not np.isfinite(gap[j - 1 : j + 2]).all():
        return Gap(float(gap[j]), float(upper[j, 0]), float(s[tip + j]))
    offset = _vertex(gap[j - 1], gap[j], gap[j + 1])
    height = gap[j] - 0.25 * (gap[j - 1] - gap[j + 1]) * offset
    nodes = np.arange(len(upper))
    x, s_there = (np.interp(j + offset, nodes, values) for values in (upper[:, 0], s[tip:]))
    return Gap(float(height), float(x), float(s_there))


def _closing_minimum(gap: Array, opening: float) -> int | None:
    """Index of the smallest local minimum of `gap` (n,) after it has exceeded `opening`, if any."""
    opened = np.flatnonzero(gap > opening)
    if len(opened) == 0:
        return None
    inner = np.arange(max(int(opened[0]), 1), len(gap) - 1)
    minima = inner[(gap[inner] <= gap[inner - 1]) & (gap[inner] < gap[inner + 1])]
    return int(minima[np.argmin(gap[minima])]) if len(minima) else None


def touch_between(
    before: tuple[float, Gap | None], after: tuple[float, Gap | None], gap: float, length: float
) -> Touch | None:
    """Layer touch between two instants (time [s], Gap), where the gap falls to `gap` [m], if any.

    `length` [m] is that of the strip.
    """
    (t0, earlier), (t1, later) = before, after
    if later is None or later.height > gap:
        return None
    if earlier is None or not earlier.height > gap:  # nothing to interpolate from
        return Touch(t0 + (t1 - t0), later.x, to_grasped=length - later.s, to_fixed=later.x)
    share = (earlier.height - gap) / (earlier.height - later.height)
    x = earlier.x + share * (later.x - earlier.x)
    s = earlier.s + share * (later.s - earlier.s)
    return Touch(t0 + share * (t1 - t0), x, to_grasped=length - s, to_fixed=x)


def _vertex(left: float, here: float, right: float) -> float:
    """Offset [nodes], at most +-0.5, of the extremum of a parabola through three values."""
    bend = left - 2 * here + right
    if bend == 0:
        return 0.0
    return float(min(max(0.5 * (left - right) / bend, -0.5), 0.5))
