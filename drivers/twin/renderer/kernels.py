"""Compiled loops of the renderer: sampling of a strip's surface, splatting."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.base.jit import entry, kernel
from drivers.base.types import Array, Image

Indices = NDArray[np.int64]

FULL = 0.96  # coverage from which a pixel counts as filled, as samples leave gaps
# a plane sequence of low discrepancy
PLANE_SEQUENCE = (0.7548776662466927, 0.5698402909980532)


class MaterialRows(NamedTuple):
    """Rows of points that lie across a strip's surface, one row at each of m samples of
    its midline.

    The `counts` (m,) points of a row lie evenly from `start` (m, 2) [px] on over
    `across` (m, 2), at arc length `s` (m,) [m]; each has an `area` (m,) [px^2] and the
    brightness `shade` (m,). Over the exposure they move by `motion` (m, 2) [px], empty
    at rest.
    """

    start: Array
    across: Array
    motion: Array
    counts: Indices
    area: Array
    shade: Array
    s: Array


@entry
def sample_surface(
    rows: MaterialRows, weave: Array, grid: tuple[float, float]
) -> Array:
    """Points (6, n) of a strip's surface: u and v [px], area [px^2], brightness, arc
    length and depth [m].

    Their brightness is that of their row times the `weave`, whose rows and columns are
    powers of two. `grid` is the number of those per metre, and the width [m] that
    `rows.across` stands for; 0 for an edge, to either side of `rows.start`. Neighbours
    are shown at different instants of the exposure, which together blur.
    """
    points = np.empty((6, rows.counts.sum()))
    cells, width = grid
    n = 0
    for i in range(len(rows.counts)):
        count = rows.counts[i]
        along = int(rows.s[i] * cells) & (len(weave) - 1)
        for row in range(count):
            depth = (row + 0.5) * (1 / count)
            if width == 0:
                depth = (2 * row + 1) / count - 1
            y = depth * width
            u = rows.start[i, 0] + depth * rows.across[i, 0]
            v = rows.start[i, 1] + depth * rows.across[i, 1]
            if len(rows.motion):
                instant = i * PLANE_SEQUENCE[0] + row * PLANE_SEQUENCE[1]
                instant -= np.floor(instant) + 0.5
                u += instant * rows.motion[i, 0]
                v += instant * rows.motion[i, 1]
            points[0, n] = u
            points[1, n] = v
            points[2, n] = rows.area[i]
            points[3, n] = (
                rows.shade[i] * weave[along, int(y * cells) & (weave.shape[1] - 1)]
            )
            points[4, n] = rows.s[i]
            points[5, n] = y
            n += 1

    return points


class Sums(NamedTuple):
    """Sums over the strip's material in each pixel of a window that any material
    reaches.

    `values` (n, channels) are coverage, brightness and tints times brightness, numbered
    from 1; `pixels` (n,) their flat pixel indices, `numbers` (rows, columns) the number
    of each pixel's sum, NO_SUM for none.
    """

    values: Array
    pixels: Indices
    numbers: NDArray[np.int32]


NO_SUM = 0


@kernel
def _share(area: float, a: float, b: float, corner: tuple[int, int]) -> float:
    """Part of a point's `area` that falls to one `corner` (row, column) of 2 x 2
    pixels, as it lies at the fractions `a` right and `b` down.
    """
    share = area * a
    if corner[1] == 0:
        share = area - share
    return share * b if corner[0] == 1 else share - share * b


@kernel
def _gather(
    sums: Sums,
    count: int,
    points: Array,
    tint: Array,
    origin: tuple[int, int],
    corner: tuple[int, int],
) -> int:
    """Add to `sums` the part of each point that falls to one `corner` (row, column) of
    the 2 x 2 pixels around it.

    `points` (6, n) begin with u, v [px], area and brightness, `tint` (n, c) their
    colours; the first pixel of the window is `origin` (u, v). `count` pixels have a sum
    so far; returns how many have one now.
    """
    numbers = sums.numbers
    rows, columns = numbers.shape
    for k in range(points.shape[1]):
        u = points[0, k] - origin[0]
        v = points[1, k] - origin[1]
        left = int(u)
        top = int(v)
        if u < 0 or v < 0 or left >= columns - 1 or top >= rows - 1:
            continue  # outside of the window

        share = _share(points[2, k], u - left, v - top, corner)
        glow = share * points[3, k]
        row = top + corner[0]
        column = left + corner[1]
        if numbers[row, column] == NO_SUM:
            count += 1
            numbers[row, column] = count
            sums.pixels[count] = row * columns + column

        pixel = sums.values[numbers[row, column]]
        pixel[0] += share
        pixel[1] += glow
        for channel in range(tint.shape[1]):
            pixel[2 + channel] += glow * tint[k, channel]
    return count


@kernel
def _blend(pixel: Image, sums: Array, colour: Array, light: float) -> None:
    """Blend material with its `sums` of coverage, brightness and tints into a `pixel`
    (3,) in BGR; `colour` counts where there are no tints.
    """
    coverage = sums[0]
    glow = sums[1]
    alpha = min(coverage / FULL, 1.0)
    ink = glow / max(coverage, 1e-12) * light * alpha
    for channel in range(3):
        mixed = (
            colour[channel] if len(sums) == 2 else sums[2 + channel] / max(glow, 1e-12)
        )
        level = pixel[channel] * (1 - alpha) + ink * mixed + 0.5
        pixel[channel] = np.uint8(min(level, 255.0))


@entry
def splat(
    image: Image,
    points: Array,
    tint: Array,
    colour: Array,
    light: NDArray[np.float32],
    origin: tuple[int, int],
) -> None:
    """Draw `points` (6, n) of the strip's surface over `image`, a window whose first
    pixel in the frame is `origin` (u, v).

    A point spreads its area bilinearly over the four nearest pixels, which preserves
    its first moment; the sum in a pixel is its coverage. The ink is `colour` (3,) BGR,
    or the mean of `tint` (n, 3) by brightness where that is not empty, under the
    `light` of the frame.
    """
    largest_count = 4 * points.shape[1] + 1
    columns = image.shape[1]
    values = np.zeros((largest_count, 2 + tint.shape[1]))
    numbers = np.zeros(image.shape[:2], np.int32)
    sums = Sums(values, np.empty(largest_count, np.int64), numbers)

    count = 0
    for down in range(2):
        for right in range(2):
            count = _gather(sums, count, points, tint, origin, (down, right))

    for n in range(1, count + 1):
        if values[n, 0] != 0:
            v = sums.pixels[n] // columns
            u = sums.pixels[n] % columns
            _blend(image[v, u], values[n], colour, light[origin[1] + v, origin[0] + u])
