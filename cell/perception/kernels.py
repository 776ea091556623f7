"""Compiled loops over pixels: which cells changed, the share of strip in their pixels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cell.perception.levels import LEVEL_SPAN, ZERO_LEVEL
from drivers.strip.rod.compiled import entry, kernel
from drivers.types import Image

CELL_PX = 8  # px, side of a cell, by which change is detected
PATCH_PX = 2 * CELL_PX  # px, side of a patch, by which light is read
EVEN_LIGHT = 120  # level of light as bright as at preflight
SHADE = 0.15  # share of brightness by which the strip's own colour changes as it turns
# separation under which a colour cannot be distinguished from what is behind it
LEAST_SEPARATION = 2.0

Floats = NDArray[np.float32]
Offsets = NDArray[np.int64]


@kernel
def _fisher(
    mixed: Any, of_own: Any, of_scene: Any, shade: Any, variance: Any
) -> tuple[Any, Any, Any]:
    """Fisher's direction a colour + b scene that separates strip from scene: a and b, and the
    scatter's determinant, by which both are multiplied.

    The products of colours are `mixed` (own by scene), `of_own` and `of_scene`; the scatter is the
    sensor's `variance`, SHADE of the strip's brightness and `shade` of the scene's.
    """
    own = np.float32(SHADE * SHADE)
    p, q = variance + own * of_own, variance + shade * shade * of_scene
    cross = np.float32(SHADE) * shade * mixed
    return q + own * mixed, -(p + shade * shade * mixed), p * q - cross * cross


@entry
def discriminants(colour: Floats, scene: Floats, shade: Floats, variance: float) -> Floats:
    """Fisher's a and b and the squared separation, (n, 3), of `colour` (3,) from each background
    (n, 3).

    Fisher's direction is a colour + b scene. `shade` (n,) is the share of brightness by which the
    background may differ, `variance` the sensor's [grey levels squared].
    """
    found = np.empty((len(scene), 3), np.float32)
    of_own = (colour * colour).sum()
    for i in range(len(scene)):
        mixed, of_scene = (scene[i] * colour).sum(), (scene[i] * scene[i]).sum()
        a, b, det = _fisher(mixed, of_own, of_scene, shade[i], np.float32(variance))
        found[i, 0], found[i, 1] = a / det, b / det
        found[i, 2] = max((a * (of_own - mixed) + b * (mixed - of_scene)) / det, np.float32(0))
    return found


@entry
def brightness(image: Image, left: int, top: int, rows: int, columns: int) -> Floats:
    """(rows, columns) sum of the channels in the middle of each patch of `image` (h, w, 3), of
    which the first begins at column `left` and row `top` [px].
    """
    found = np.empty((rows, columns), np.float32)
    for i in range(rows):
        for j in range(columns):
            total = np.int32(0)
            for v in range(2):
                row = min(top + PATCH_PX * i + PATCH_PX // 2 + 4 * v - 3, image.shape[0] - 1)
                for u in range(2):
                    column = min(
                        left + PATCH_PX * j + PATCH_PX // 2 + 4 * u - 3, image.shape[1] - 1
                    )
                    for c in range(3):
                        total += np.int32(image[row, column, c])
            found[i, j] = np.float32(total) / 4
    return found


@entry
def changed_cells(
    seen: Image, behind: Image, light: Image, left: int, top: int, limit: float
) -> Image:
    """(n, m) 1 where a cell differs by more than `limit` [grey levels] a channel in the mean.

    Every fourth row of the images (h, 3 w) counts, B, G, R in turn; `light` (n, m) is that of the
    cells, of which the first begins at column `left` and row `top` [px].
    """
    rows, columns = light.shape
    found = np.zeros((rows, columns), np.uint8)
    inside = min(columns, (seen.shape[1] // 3 - left) // CELL_PX)
    for i in range(rows):
        away = np.zeros(columns, np.int32)
        lines = 0
        for v in range(top + CELL_PX * i + 1, min(top + CELL_PX * (i + 1), seen.shape[0]), 4):
            now, then = seen[v], behind[v]
            lines += 1
            for j in range(inside):
                first, bright, total = (
                    3 * (left + CELL_PX * j),
                    np.int32(light[i, j]),
                    np.int32(0),
                )
                for c in range(3 * CELL_PX):
                    difference = np.int32(now[first + c]) * np.int32(EVEN_LIGHT)
                    total += abs(difference - np.int32(then[first + c]) * bright)
                away[j] += total
        most = limit * EVEN_LIGHT * 3 * CELL_PX * lines
        for j in range(inside):
            found[i, j] = away[j] > most
    return found


@kernel
def _between(light: Floats, v: int, u: int) -> Any:
    """Light (n + 2, m + 2) of cells with a border, interpolated at row v and column u [px]."""
    half = np.float32(0.5) / np.float32(CELL_PX)
    y = np.float32(v) / np.float32(CELL_PX) + half + np.float32(0.5)
    x = np.float32(u) / np.float32(CELL_PX) + half + np.float32(0.5)
    i, j = int(y), int(x)
    down, right = y - np.float32(i), x - np.float32(j)
    upper = light[i, j] + right * (light[i, j + 1] - light[i, j])
    lower = light[i + 1, j] + right * (light[i + 1, j + 1] - light[i + 1, j])
    return upper + down * (lower - upper)


@kernel
def _share(
    now: tuple[Any, Any, Any],
    then: tuple[Any, Any, Any],
    shade: Any,
    colours: Floats,
    variance: Any,
) -> Any:
    """Share of strip in a pixel of colour `now`, in even light, whose background is `then`."""
    s0, s1, s2 = then
    d0, d1, d2 = now[0] - s0, now[1] - s1, now[2] - s2
    of_scene, along = s0 * s0 + s1 * s1 + s2 * s2, d0 * s0 + d1 * s1 + d2 * s2
    best = np.float32(0)
    for k in range(len(colours)):
        c0, c1, c2 = colours[k, 0], colours[k, 1], colours[k, 2]
        own, mixed = c0 * c0 + c1 * c1 + c2 * c2, s0 * c0 + s1 * c1 + s2 * c2
        a, b, det = _fisher(mixed, own, of_scene, shade, variance)
        reach = a * (own - mixed) + b * (mixed - of_scene)
        if reach > np.float32(LEAST_SEPARATION * LEAST_SEPARATION) * det:
            found = (a * (d0 * c0 + d1 * c1 + d2 * c2) + b * along) / reach
            best = max(best, found)
    return best


@kernel
def _colour(image: Image, v: int, u: int, gain: Any) -> tuple[Any, Any, Any]:
    """Pixel of `image` (h, w, 3) at row v, column u, times `gain`."""
    return (
        np.float32(image[v, u, 0]) * gain,
        np.float32(image[v, u, 1]) * gain,
        np.float32(image[v, u, 2]) * gain,
    )


@entry
def segment(
    seen: Image,
    behind: Image,
    shade: Floats,
    light: Floats,
    cells: Image,
    colours: Floats,
    variance: float,
    corner: tuple[int, int],
) -> Image:
    """Matte levels (CELL_PX n, CELL_PX m) where `cells` (n, m) is not 0, else ZERO_LEVEL.

    The images (height, width, 3) and `shade` (height, width) are whole, `light` (n + 2, m + 2)
    that of the cells and a border of one, of which the first inside begins at `corner`, column
    and row [px]. Of `colours` (k, 3) the one counts that a pixel shows most of.
    """
    left, top = corner
    rows, columns = cells.shape
    levels = np.full((rows * CELL_PX, columns * CELL_PX), ZERO_LEVEL, np.uint8)
    noise = np.float32(variance)
    for i in range(rows):
        for j in range(columns):
            if cells[i, j] == 0:
                continue
            for v in range(CELL_PX * i, min(CELL_PX * (i + 1), seen.shape[0] - top)):
                for u in range(CELL_PX * j, min(CELL_PX * (j + 1), seen.shape[1] - left)):
                    y, x = top + v, left + u
                    gain = np.float32(EVEN_LIGHT) / _between(light, v, u)
                    now, then = _colour(seen, y, x, gain), _colour(behind, y, x, np.float32(1))
                    best = _share(now, then, shade[y, x], colours, noise)
                    level = np.float32(ZERO_LEVEL) + np.float32(LEVEL_SPAN) * best + np.float32(0.5)
                    levels[v, u] = np.uint8(min(level, np.float32(255)))
    return levels


@entry
def silhouette_of(
    levels: Image, strip: Image, lifted: Image, lines: Offsets, solid: int, faint: int
) -> Image:
    """Mask (h, w), 255 in the zone `strip` where `levels` exceed `solid`, and where in the zone
    `lifted` their mean exceeds `faint` along one of `lines` (k, n, 2) of rows and columns.
    """
    h, w = levels.shape
    mask = np.zeros((h, w), np.uint8)
    count, length = lines.shape[:2]
    half = ZERO_LEVEL + (faint - ZERO_LEVEL) // 2
    for v in range(h):
        for u in range(w):
            level = levels[v, u]
            if level <= half or strip[v, u] == 0:
                continue
            if level > solid:
                mask[v, u] = 255
            elif lifted[v, u] != 0:
                for k in range(count):
                    total = 0
                    for n in range(length):
                        row = min(max(v + lines[k, n, 0], 0), h - 1)
                        column = min(max(u + lines[k, n, 1], 0), w - 1)
                        total += levels[row, column]
                    if total > faint * length:
                        mask[v, u] = 255
                        break
    return mask
