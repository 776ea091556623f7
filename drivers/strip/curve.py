"""Signed distances of measured points from a moving midline, and their robust means."""

import math
from typing import Any

import numpy as np

from drivers.strip.rod.compiled import entry, kernel

AROUND = 0.08  # m of the strip on each side of where a point should lie
STRIDE = 4  # nodes
WILD = 3.0  # robust standard deviations beyond which a value counts no more than that


@kernel
def node(shapes: Any, j: int, w: float, q: int) -> Any:
    """Node `q` at a fraction between the shapes j and j + 1."""
    k = min(j + 1, len(shapes) - 1)
    x = (1.0 - w) * shapes[j, q, 0] + w * shapes[k, q, 0]
    z = (1.0 - w) * shapes[j, q, 1] + w * shapes[k, q, 1]
    return x, z


@kernel
def curvature(shapes: Any, j: int, w: float, q: int) -> Any:
    """Curvature [1/m] at node q from the turn of its two segments, 0 at the ends."""
    if q == 0 or q == shapes.shape[1] - 1:
        return 0.0
    (xa, za), (xb, zb) = node(shapes, j, w, q - 1), node(shapes, j, w, q)
    xc, zc = node(shapes, j, w, q + 1)
    ux, uz, vx, vz = xb - xa, zb - za, xc - xb, zc - zb
    first, second = math.hypot(ux, uz), math.hypot(vx, vz)
    return 2.0 * (ux * vz - uz * vx) / (first * second * (first + second))


@kernel
def beside(shapes: Any, j: int, w: float, q: int, x: float, z: float) -> Any:
    """Distance to segment q, and signed distance to the arc that stands on it, left positive."""
    last = shapes.shape[1] - 2
    (xa, za), (xb, zb) = node(shapes, j, w, q), node(shapes, j, w, q + 1)
    length = math.hypot(xb - xa, zb - za)
    tx, tz = (xb - xa) / length, (zb - za) / length
    along = ((x - xa) * tx + (z - za) * tz) / length
    across = (z - za) * tx - (x - xa) * tz
    low = 0.0 if q > 0 else -math.inf
    high = 1.0 if q < last else math.inf
    inside = min(max(along, low), high)
    off = (along - inside) * length
    distance = math.hypot(across, off)
    bend = 0.5 * (curvature(shapes, j, w, q) + curvature(shapes, j, w, q + 1))
    share = min(max(inside, 0.0), 1.0)
    bulge = 0.5 * bend * length * length * share * (1.0 - share)
    return distance, math.copysign(distance, across) + bulge


@kernel
def nearest(shapes: Any, j: int, w: float, low: int, high: int, x: float, z: float) -> Any:
    """The node of low..high nearest to (x, z): every STRIDE-th first, then its neighbourhood."""
    best = nearest_of(shapes, j, w, range(low, high + 1, STRIDE), x, z)
    close = range(max(best - STRIDE + 1, low), min(best + STRIDE, high + 1))
    return nearest_of(shapes, j, w, close, x, z)


@kernel
def nearest_of(shapes: Any, j: int, w: float, nodes: Any, x: float, z: float) -> Any:
    """The one of `nodes` that is nearest to (x, z)."""
    best, least = 0, math.inf
    for q in nodes:
        px, pz = node(shapes, j, w, q)
        square = (px - x) ** 2 + (pz - z) ** 2
        if square < least:
            best, least = q, square
    return best


@kernel
def around(arc: Any, s: float) -> Any:
    """First and last node within AROUND of arc length s, clamped to the strip."""
    last = len(arc) - 1
    low = np.searchsorted(arc, min(s, arc[last]) - AROUND) - 1
    high = np.searchsorted(arc, max(s, 0.0) + AROUND)
    return max(low, 0), min(high, last)


@entry
def signed_distances(
    points: Any, image: Any, near: Any, places: Any, shapes: Any, arc: Any, found: Any
) -> None:
    """Distance (n,) [m] of each of points (n, 2) to the midline of its moment into `found`.

    Positive to the left of the way from the fixed to the grasped edge. Point p belongs to
    `image` (n,), which shows the world at `places` (m,), a fractional index into `shapes`
    (k, nodes, 2) with nodes at `arc` (nodes,) [m]; its foot lies within AROUND of `near` (n,)
    [m]. Segments count as arcs.
    """
    last = shapes.shape[1] - 1
    for p in range(len(points)):
        place = min(max(places[image[p]], 0.0), len(shapes) - 1.0)
        j = int(place)
        w = place - j
        x, z = points[p, 0], points[p, 1]
        low, high = around(arc, near[p])
        q = nearest(shapes, j, w, low, high, x, z)
        best, found[p] = math.inf, 0.0
        for segment in (q - 1, q):
            if 0 <= segment < last:
                distance, signed = beside(shapes, j, w, segment, x, z)
                if distance < best:
                    best, found[p] = distance, signed


@entry
def group_means(values: Any, edges: Any, sigma: float, mean: Any, square: Any) -> None:
    """Mean and mean square of each group values[edges[g]:edges[g + 1]], wild ones clipped.

    Values count no more than `WILD` robust deviations (at least `sigma`) from the group's median.
    """
    for g in range(len(edges) - 1):
        group = values[edges[g] : edges[g + 1]]
        middle = np.median(group)
        spread = max(sigma, 1.4826 * np.median(np.abs(group - middle)))
        total, power = 0.0, 0.0
        for value in group:
            kept = min(max(value, middle - WILD * spread), middle + WILD * spread)
            total += kept
            power += kept * kept
        mean[g], square[g] = total / len(group), power / len(group)
