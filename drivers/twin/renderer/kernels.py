"""Compiled loops of the renderer: projection of a midline, sampling of its surface, splatting."""

import numpy as np
from numpy.typing import NDArray

from drivers.strip.rod.compiled import entry, kernel
from drivers.types import Array, Image

Indices = NDArray[np.int64]

FULL = 0.96  # coverage from which a pixel counts as filled, as samples leave gaps
PLANE_SEQUENCE = (0.7548776662466927, 0.5698402909980532)  # a plane sequence of low discrepancy


@entry
def project_plane_points(
    points: Array,
    y: float,
    centre: Array,
    m: Array,
    focal: float,
    principal: tuple[float, float],
    distortion: tuple[float, float],
) -> Array:
    """Pixels (n, 2) of `points` (n, 2) of x, z [m] in the plane at `y` [m].

    The camera at `centre` (3,) has the rotation `m` (3, 3); other arguments are as in `Optics`.
    """
    (u, v), (k1, k2) = principal, distortion
    pixels = np.empty((len(points), 2))
    for i in range(len(points)):
        x, z = points[i, 0] - centre[0], points[i, 1] - centre[2]
        right = m[0, 0] * x + m[0, 2] * z + (y - centre[1]) * m[0, 1]
        down = m[1, 0] * x + m[1, 2] * z + (y - centre[1]) * m[1, 1]
        inverse = 1 / (m[2, 0] * x + m[2, 2] * z + (y - centre[1]) * m[2, 1])
        a, b = right * inverse, down * inverse
        r2 = a * a + b * b
        scale = (1 + r2 * (k1 + k2 * r2)) * focal
        pixels[i, 0], pixels[i, 1] = a * scale + u, b * scale + v
    return pixels


@entry
def interpolate(nodes: Array, slopes: Array, arc: Array, s: Array) -> tuple[Array, Array]:
    """Points and derivatives (m, 2) of a cubic Hermite curve at increasing arc lengths `s` (m,).

    It passes through `nodes` (n, 2) with `slopes` (n, 2) at arc lengths `arc` (n,).
    """
    points, derivatives = np.empty((len(s), 2)), np.empty((len(s), 2))
    i = 0
    for k in range(len(s)):
        while i < len(arc) - 2 and arc[i + 1] <= s[k]:
            i += 1
        h = arc[i + 1] - arc[i]
        t = (s[k] - arc[i]) / h
        for c in range(2):
            p0, m0, m1 = nodes[i, c], slopes[i, c], slopes[i + 1, c]
            chord = (nodes[i + 1, c] - p0) / h
            c2 = 3 * chord - 2 * m0 - m1
            c3 = m0 + m1 - 2 * chord
            points[k, c] = p0 + h * t * (m0 + t * (c2 + t * c3))
            derivatives[k, c] = m0 + t * (2 * c2 + 3 * t * c3)
    return points, derivatives


@entry
def bin_maxima(bins: Indices, values: Array, count: int) -> Array:
    """Largest of `values` (m,) in each of `count` bins, at least 0; `bins` (m,) number them."""
    maxima = np.zeros(count)
    for k in range(len(bins)):
        maxima[bins[k]] = max(maxima[bins[k]], values[k])
    return maxima


@entry
def sample_surface(
    start: Array,
    across: Array,
    motion: Array,
    rows: Indices,
    area: Array,
    shade: Array,
    s: Array,
    weave: Array,
    grid: tuple[float, float],
) -> Array:
    """Material points (6, n): u and v [px], area [px^2], brightness, arc length and depth [m].

    Sample i of a curve, at arc length `s[i]`, has `rows[i]` points of `area[i]`, evenly from
    `start` (m, 2) on over `across` (m, 2). Their brightness is `shade` times the `weave`, whose
    rows and columns are powers of two. `grid` is the number of those per metre, and the width [m]
    that `across` stands for; 0 for an edge, to either side of `start`. Points move by `motion`
    (m, 2), empty at rest: neighbours are shown at different instants, which together blur.
    """
    points = np.empty((6, rows.sum()))
    cells, width = grid
    n = 0
    for i in range(len(rows)):
        along = int(s[i] * cells) & (len(weave) - 1)
        for row in range(rows[i]):
            depth = (2 * row + 1) / rows[i] - 1 if width == 0 else (row + 0.5) * (1 / rows[i])
            y = depth * width
            u, v = start[i, 0] + depth * across[i, 0], start[i, 1] + depth * across[i, 1]
            if len(motion):
                instant = i * PLANE_SEQUENCE[0] + row * PLANE_SEQUENCE[1]
                instant -= np.floor(instant) + 0.5
                u, v = u + instant * motion[i, 0], v + instant * motion[i, 1]
            points[0, n], points[1, n], points[2, n] = u, v, area[i]
            points[3, n] = shade[i] * weave[along, int(y * cells) & (weave.shape[1] - 1)]
            points[4, n], points[5, n] = s[i], y
            n += 1
    return points


@kernel
def _gather(
    sums: Array,
    numbered: tuple[NDArray[np.int32], Indices, int],
    points: Array,
    tint: Array,
    origin: tuple[int, int],
    low: int,
    right: int,
) -> int:
    """Add the share of each point in one of the four pixels around it to `sums` (n, channels).

    `low` and `right`, 0 or 1, choose the pixel. Pixels get sums when first needed, numbered from 1:
    `numbered` holds the number of each pixel (rows, columns) from `origin` on, 0 without a sum, the
    flat pixel index of each sum (n,), and the number of sums in use, of which the new is returned.
    """
    places, pixels, taken = numbered
    (u0, v0), (rows, columns) = origin, places.shape
    for k in range(points.shape[1]):
        u, v = points[0, k] - u0, points[1, k] - v0
        j, i = int(u), int(v)
        if u < 0 or v < 0 or j >= columns - 1 or i >= rows - 1:
            continue
        a, b = u - j, v - i
        share = points[2, k] * a
        if right == 0:
            share = points[2, k] - share
        share = share * b if low == 1 else share - share * b
        glow = share * points[3, k]
        if places[i + low, j + right] == 0:
            taken += 1
            places[i + low, j + right], pixels[taken] = taken, (i + low) * columns + j + right
        pixel = sums[places[i + low, j + right]]
        pixel[0] += share
        pixel[1] += glow
        for c in range(tint.shape[1]):
            pixel[2 + c] += glow * tint[k, c]
    return taken


@entry
def splat(
    image: Image,
    points: Array,
    tint: Array,
    colour: Array,
    light: NDArray[np.float32],
    origin: tuple[int, int],
) -> None:
    """Draw material `points` (6, n) over `image`, a window of the frame from `origin` (u, v) on.

    A point spreads its area bilinearly over the four nearest pixels, which preserves its first
    moment; the sum in a pixel is its coverage. The ink is `colour` (3,) BGR, or the mean of `tint`
    (n, 3) by brightness where that is not empty, under the `light` of the frame.
    """
    columns = image.shape[1]
    most = 4 * points.shape[1] + 1
    sums, pixels, taken = np.zeros((most, 2 + tint.shape[1])), np.empty(most, np.int64), 0
    places = np.zeros(image.shape[:2], np.int32)
    for low in range(2):
        for right in range(2):
            taken = _gather(sums, (places, pixels, taken), points, tint, origin, low, right)
    for n in range(1, taken + 1):
        coverage, glow = sums[n, 0], sums[n, 1]
        if coverage == 0:
            continue
        v, u = pixels[n] // columns, pixels[n] % columns
        alpha = min(coverage / FULL, 1.0)
        ink = glow / max(coverage, 1e-12) * light[origin[1] + v, origin[0] + u] * alpha
        for c in range(3):
            mixed = colour[c] if tint.shape[1] == 0 else sums[n, 2 + c] / max(glow, 1e-12)
            level = image[v, u, c] * (1 - alpha) + ink * mixed + 0.5
            image[v, u, c] = np.uint8(min(level, 255.0))
