"""Residuals of measured points and contacts to a strip's moving midline, and their
robust means.
"""

import math
from typing import Any

import numpy as np

from drivers.base.geometry import MAD
from drivers.base.jit import entry, kernel

SEARCH_SPAN = 0.08  # m of the strip on each side of where a point should lie
STRIDE = 4  # nodes
# robust standard deviations beyond which a value counts no more than that
OUTLIER = 3.0


@entry
def interpolate_midlines(shapes: Any, places: Any) -> Any:
    """Midlines interpolated linearly between successive `shapes`, one for each
    fractional index in `places`; a midline has a row of x and z [m] for each node.
    """
    curves = np.empty((len(places), shapes.shape[1], 2))
    for m in range(len(places)):
        place = min(max(places[m], 0.0), len(shapes) - 1.0)
        j = int(place)
        k = min(j + 1, len(shapes) - 1)
        w = place - j
        curves[m] = (1.0 - w) * shapes[j] + w * shapes[k]
    return curves


@kernel
def chord(curve: Any, q: int) -> Any:
    """Components along x and z [m], and length [m], of the straight segment that joins
    node `q` of a `curve` with the next one.
    """
    x = curve[q + 1, 0] - curve[q, 0]
    z = curve[q + 1, 1] - curve[q, 1]
    return x, z, math.hypot(x, z)


@kernel
def curvature(before: Any, after: Any) -> Any:
    """Curvature [1/m] of a curve at the node between two successive segments, each
    given by its components along x and z and its length.
    """
    (ux, uz, first), (vx, vz, second) = before, after
    return 2.0 * (ux * vz - uz * vx) / (first * second * (first + second))


@kernel
def _distances_to_segment(
    curve: Any, q: int, base: Any, bend: float, x: float, z: float
) -> Any:
    """Distance [m] of the point `x`, `z` from the segment of a curve that begins at
    node `q`, and its signed distance from the arc over that segment, positive to the
    left.

    The arc over the segment's chord `base` has the mean curvature `bend` [1/m].
    """
    dx, dz, length = base
    tx = dx / length
    tz = dz / length
    along = ((x - curve[q, 0]) * tx + (z - curve[q, 1]) * tz) / length
    across = (z - curve[q, 1]) * tx - (x - curve[q, 0]) * tz
    low = 0.0 if q > 0 else -math.inf
    high = 1.0 if q < len(curve) - 2 else math.inf
    inside = min(max(along, low), high)
    beyond_end = (along - inside) * length
    distance = math.hypot(across, beyond_end)
    fraction = min(max(inside, 0.0), 1.0)
    bulge = 0.5 * bend * length * length * fraction * (1.0 - fraction)
    return distance, math.copysign(distance, across) + bulge


@kernel
def _signed_distance(curve: Any, q: int, x: float, z: float) -> Any:
    """Signed distance [m], positive to the left, of the point `x`, `z` from the nearer
    of the two segments that meet at node `q` of a `curve`.
    """
    last = len(curve) - 1
    best = math.inf
    nearest = 0.0
    base = chord(curve, max(q - 1, 0))
    # straight at both ends
    bend = curvature(chord(curve, q - 2), base) if q > 1 else 0.0

    for segment in range(max(q - 1, 0), min(q + 1, last)):
        ahead = base
        bend_ahead = 0.0
        if segment + 1 < last:
            ahead = chord(curve, segment + 1)
            bend_ahead = curvature(base, ahead)

        mean = 0.5 * (bend + bend_ahead)
        distance, signed = _distances_to_segment(curve, segment, base, mean, x, z)
        if distance < best:
            best = distance
            nearest = signed

        base = ahead
        bend = bend_ahead

    return nearest


@kernel
def _nearest_node(curve: Any, low: int, high: int, x: float, z: float) -> Any:
    """Index, from `low` to `high`, of the node of `curve` that is nearest to the point
    `x`, `z`, found by a coarse and then a fine search.
    """
    best = _nearest_among(curve, range(low, high + 1, STRIDE), x, z)
    close = range(max(best - STRIDE + 1, low), min(best + STRIDE, high + 1))
    return _nearest_among(curve, close, x, z)


@kernel
def _nearest_among(curve: Any, nodes: Any, x: float, z: float) -> Any:
    """Index, out of `nodes`, of the node of `curve` that is nearest to the point `x`,
    `z`.
    """
    best = 0
    least = math.inf
    for q in nodes:
        square = (curve[q, 0] - x) ** 2 + (curve[q, 1] - z) ** 2
        if square < least:
            best = q
            least = square
    return best


@kernel
def _search_window(arc: Any, s: float) -> Any:
    """Indices of the first and last node whose arc length in `arc` [m] is near the arc
    length `s` [m].
    """
    last = len(arc) - 1
    low = np.searchsorted(arc, min(s, arc[last]) - SEARCH_SPAN) - 1
    high = np.searchsorted(arc, max(s, 0.0) + SEARCH_SPAN)
    return max(low, 0), min(high, last)


@entry
def signed_distances(
    points: Any,
    image: Any,
    near: Any,
    places: Any,
    shapes: Any,
    arc: Any,
    distances: Any,
) -> None:
    """Write into `distances` the signed distance [m] of each of the measured `points`
    from a strip's moving midline.

    Positive on the left as seen from the fixed edge. Point p belongs to image number
    `image[p]`, taken at the fractional index `places[image[p]]` into `shapes` (k,
    nodes, 2), with nodes at `arc` (nodes,) [m]; its foot is sought within SEARCH_SPAN
    of `near[p]` [m]. Segments count as arcs.
    """
    curves = interpolate_midlines(shapes, places)
    for p in range(len(points)):
        curve = curves[image[p]]
        x = points[p, 0]
        z = points[p, 1]
        low, high = _search_window(arc, near[p])
        q = _nearest_node(curve, low, high, x, z)
        distances[p] = _signed_distance(curve, q, x, z)


@kernel
def _nearest_end(curve: Any, height: float, x: float, contact: float) -> Any:
    """Coordinate [m] nearest to `x` at which a lying strip rises above `height` [m], or
    `contact` where that is nearer.
    """
    nearest = contact
    q = 1
    # up to the fold's rightmost point
    while q < len(curve) and curve[q, 0] >= curve[q - 1, 0]:
        low = curve[q - 1, 1]
        high = curve[q, 1]
        if low <= height < high:
            begin = curve[q - 1, 0]
            fraction = (height - low) / (high - low)
            place = begin + fraction * (curve[q, 0] - begin)
            if abs(place - x) < abs(nearest - x):
                nearest = place
        q += 1
    return nearest


@entry
def nearest_ends(
    x: Any, places: Any, shapes: Any, height: float, contacts: Any
) -> None:
    """Replace each of the desk `contacts` [m] by the point nearest to the one measured
    in `x` [m] at which the simulated strip rises from the desk.

    A midline lifts off wherever it rises above `height` [m]: at the fold, and at each
    hump before it. A contact stays if it is nearer. `places` (n,) and `shapes` are
    those of `signed_distances`.
    """
    curves = interpolate_midlines(shapes, places)
    for m in range(len(x)):
        contacts[m] = _nearest_end(curves[m], height, x[m], contacts[m])


@entry
def group_means(values: Any, edges: Any, sigma: float, mean: Any, square: Any) -> None:
    """Write into `mean` and `square` the mean and the mean square of each group of
    `values`, with outliers clipped.

    Group g is values[edges[g]:edges[g + 1]]. Values are clipped at OUTLIER robust
    deviations (at least `sigma`) from the group's median.
    """
    for g in range(len(edges) - 1):
        group = values[edges[g] : edges[g + 1]]
        middle = np.median(group)
        spread = max(sigma, MAD * np.median(np.abs(group - middle)))

        total, power = 0.0, 0.0
        for value in group:
            clipped = min(
                max(value, middle - OUTLIER * spread), middle + OUTLIER * spread
            )
            total += clipped
            power += clipped * clipped

        mean[g] = total / len(group)
        square[g] = power / len(group)
