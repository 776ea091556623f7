"""Signed distances of measured points from a moving midline, and their robust means."""

import math
from typing import Any

import numpy as np

from drivers.strip.rod.compiled import entry, kernel

SEARCH_SPAN = 0.08  # m of the strip on each side of where a point should lie
STRIDE = 4  # nodes
OUTLIER = 3.0  # robust standard deviations beyond which a value counts no more than that


@kernel
def between(shapes: Any, places: Any) -> Any:
    """Curves (m, nodes, 2) at fractional indices `places` (m,) into `shapes` (k, nodes, 2)."""
    curves = np.empty((len(places), shapes.shape[1], 2))
    for m in range(len(places)):
        place = min(max(places[m], 0.0), len(shapes) - 1.0)
        j = int(place)
        k, w = min(j + 1, len(shapes) - 1), place - j
        for q in range(shapes.shape[1]):
            for axis in range(2):
                curves[m, q, axis] = (1.0 - w) * shapes[j, q, axis] + w * shapes[k, q, axis]
    return curves


@kernel
def curvature(curve: Any, q: int) -> Any:
    """Curvature [1/m] at node q from the turn of its two segments, 0 at the ends."""
    if q == 0 or q == len(curve) - 1:
        return 0.0
    ux, uz = curve[q, 0] - curve[q - 1, 0], curve[q, 1] - curve[q - 1, 1]
    vx, vz = curve[q + 1, 0] - curve[q, 0], curve[q + 1, 1] - curve[q, 1]
    first, second = math.hypot(ux, uz), math.hypot(vx, vz)
    return 2.0 * (ux * vz - uz * vx) / (first * second * (first + second))


@kernel
def beside(curve: Any, q: int, x: float, z: float) -> Any:
    """Distance to segment q, and signed distance to the arc that stands on it, left positive."""
    last = len(curve) - 2
    xa, za = curve[q, 0], curve[q, 1]
    xb, zb = curve[q + 1, 0], curve[q + 1, 1]
    length = math.hypot(xb - xa, zb - za)
    tx, tz = (xb - xa) / length, (zb - za) / length
    along = ((x - xa) * tx + (z - za) * tz) / length
    across = (z - za) * tx - (x - xa) * tz
    low = 0.0 if q > 0 else -math.inf
    high = 1.0 if q < last else math.inf
    inside = min(max(along, low), high)
    off = (along - inside) * length
    distance = math.hypot(across, off)
    bend = 0.5 * (curvature(curve, q) + curvature(curve, q + 1))
    share = min(max(inside, 0.0), 1.0)
    bulge = 0.5 * bend * length * length * share * (1.0 - share)
    return distance, math.copysign(distance, across) + bulge


@kernel
def nearest(curve: Any, low: int, high: int, x: float, z: float) -> Any:
    """The node of low..high nearest to (x, z): every STRIDE-th first, then its neighbourhood."""
    best = nearest_of(curve, range(low, high + 1, STRIDE), x, z)
    close = range(max(best - STRIDE + 1, low), min(best + STRIDE, high + 1))
    return nearest_of(curve, close, x, z)


@kernel
def nearest_of(curve: Any, nodes: Any, x: float, z: float) -> Any:
    """The one of `nodes` that is nearest to (x, z)."""
    best, least = 0, math.inf
    for q in nodes:
        square = (curve[q, 0] - x) ** 2 + (curve[q, 1] - z) ** 2
        if square < least:
            best, least = q, square
    return best


@kernel
def around(arc: Any, s: float) -> Any:
    """First and last node within SEARCH_SPAN of arc length s, clamped to the strip."""
    last = len(arc) - 1
    low = before(arc, min(s, arc[last]) - SEARCH_SPAN)
    high = before(arc, max(s, 0.0) + SEARCH_SPAN) + 1
    return max(low, 0), min(high, last)


@kernel
def before(arc: Any, s: float) -> Any:
    """The last node whose arc length is less than s; -1 where there is none."""
    low, high = -1, len(arc)
    while high - low > 1:
        middle = (low + high) // 2
        if arc[middle] < s:
            low = middle
        else:
            high = middle
    return low


@entry
def signed_distances(
    points: Any, image: Any, near: Any, places: Any, shapes: Any, arc: Any, found: Any
) -> None:
    """Distance (n,) [m] of each of points (n, 2) to the midline of its moment into `found`.

    Positive to the left of the way from the fixed to the grasped edge. Point p belongs to
    `image` (n,), which shows the world at `places` (m,), a fractional index into `shapes`
    (k, nodes, 2) with nodes at `arc` (nodes,) [m]; its foot lies within SEARCH_SPAN of `near` (n,)
    [m]. Segments count as arcs.
    """
    last, curves = shapes.shape[1] - 1, between(shapes, places)
    for p in range(len(points)):
        curve, x, z = curves[image[p]], points[p, 0], points[p, 1]
        low, high = around(arc, near[p])
        q = nearest(curve, low, high, x, z)
        best, found[p] = math.inf, 0.0
        for segment in (q - 1, q):
            if 0 <= segment < last:
                distance, signed = beside(curve, segment, x, z)
                if distance < best:
                    best, found[p] = distance, signed


@entry
def group_means(values: Any, edges: Any, sigma: float, mean: Any, square: Any) -> None:
    """Mean and mean square of each group values[edges[g]:edges[g + 1]], wild ones clipped.

    Values count at most `OUTLIER` robust deviations (at least `sigma`) from the group's median.
    """
    for g in range(len(edges) - 1):
        group = values[edges[g] : edges[g + 1]]
        middle = np.median(group)
        spread = max(sigma, 1.4826 * np.median(np.abs(group - middle)))
        total, power = 0.0, 0.0
        for value in group:
            kept = min(max(value, middle - OUTLIER * spread), middle + OUTLIER * spread)
            total += kept
            power += kept * kept
        mean[g], square[g] = total / len(group), power / len(group)
