"""Compiled loops over pixels: changed cells, share of strip in each pixel, mask of the strip."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.strip.rod.compiled import entry, kernel
from drivers.types import Array, Image

ZERO_LEVEL = 48  # grey level of all background
LEVEL_SPAN = 160  # grey levels from there to all strip


def smooth_matte(levels: Image) -> Image:
    """Smooth matte `levels` (h, w), grey levels of strip share, to half their noise."""
    return np.asarray(cv2.GaussianBlur(levels, (3, 3), 0), dtype=np.uint8)


def strip_share(levels: Array | Image) -> Array:
    """Convert matte grey levels (...,) to shares of strip (...,), 0 to 1 and slightly beyond."""
    return np.asarray((np.asarray(levels, dtype=np.float64) - ZERO_LEVEL) / LEVEL_SPAN)


CELL_PX = 8  # px, side of a cell, by which change is detected
FIRST_ROW, ROW_STEP = 1, 4  # px, the rows of a cell that are compared
PATCH_PX = 2 * CELL_PX  # px, side of a patch, by which light is read
EVEN_LIGHT = 120  # level of light as bright as at preflight
SHADE = 0.15  # relative change of the strip's brightness as it bends
# separation below which a colour cannot be distinguished from the background
LEAST_SEPARATION = 2.0

Floats = NDArray[np.float32]
Offsets = NDArray[np.int64]


def _fisher(
    mixed: Any, of_strip: Any, of_scene: Any, shade: Any, variance: Any
) -> tuple[Any, Any, Any]:
    """Fisher's linear discriminant of strip and scene: factors a and b of the two colours.

    Its direction is (a strip + b scene) / det; det, returned too, is the scatter's determinant.
    The products of colours are `mixed` (strip by scene), `of_strip` and `of_scene`; the scatter is
    the sensor's `variance`, SHADE of the strip's brightness and `shade` of the scene's.
    """
    bending = np.float32(SHADE * SHADE)
    p = variance + bending * of_strip
    q = variance + shade * shade * of_scene
    cross = np.float32(SHADE) * shade * mixed
    return q + bending * mixed, -(p + shade * shade * mixed), p * q - cross * cross


_compiled_fisher = kernel(_fisher)


def discriminants(
    colour: Floats, scene: Floats, shade: Floats, variance: float
) -> tuple[Floats, Floats]:
    """Squared separation (n,) [sigma^2] of `colour` (3,) from background colours (n, 3).

    Also returns the length (n,) of Fisher's linear discriminant. `shade` (n,) is the share of
    brightness by which the background may differ, `variance` the sensor's [grey levels squared].
    """
    mixed = (scene * colour).sum(axis=1)
    of_strip = (colour * colour).sum()
    of_scene = (scene * scene).sum(axis=1)
    a, b, det = _fisher(mixed, of_strip, of_scene, shade, np.float32(variance))
    separation = (a * (of_strip - mixed) + b * (mixed - of_scene)) / det
    direction = (a / det)[:, None] * colour + (b / det)[:, None] * scene
    return np.maximum(separation, 0), np.sqrt((direction * direction).sum(axis=1))


@entry
def brightness(image: Image, left: int, top: int, rows: int, columns: int) -> Floats:
    """Brightness (rows, columns), summed over the channels, of each patch of `image` (h, w, 3).

    A mean of 4 pixels about its middle; the first patch begins at column `left`, row `top` [px].
    """
    patches = np.empty((rows, columns), np.float32)
    half = PATCH_PX // 2
    for i in range(rows):
        for j in range(columns):
            total = np.int32(0)
            for v in range(2):
                row = min(top + PATCH_PX * i + half + 4 * v - 3, image.shape[0] - 1)
                for u in range(2):
                    column = min(left + PATCH_PX * j + half + 4 * u - 3, image.shape[1] - 1)
                    for c in range(3):
                        total += np.int32(image[row, column, c])
            patches[i, j] = np.float32(total) / 4
    return patches


@entry
def changed_cells(
    image: Image, background: Image, light: Image, left: int, top: int, limit: float
) -> Image:
    """Mask (n, m) of cells that differ from the background: 1 where changed, else 0.

    Images (h, 3 w) are B, G, R in turn; `light` (n, m) is the cells', the first of which begins at
    column `left`, row `top` [px]. Changed is one whose mean over every ROW_STEP-th row differs by
    more than `limit` [grey levels] per channel; one that the right border cuts never is.
    """
    rows, columns = light.shape
    changed = np.zeros((rows, columns), np.uint8)
    inside = min(columns, (image.shape[1] // 3 - left) // CELL_PX)
    for i in range(rows):
        above = top + CELL_PX * i
        sampled = range(above + FIRST_ROW, min(above + CELL_PX, image.shape[0]), ROW_STEP)
        differences = np.zeros(columns, np.int32)
        for v in sampled:
            for j in range(inside):
                first = 3 * (left + CELL_PX * j)
                pixels, scene = image[v, first:], background[v, first:]
                level = np.int32(light[i, j])
                total = np.int32(0)
                for c in range(3 * CELL_PX):  # in a function of its own this takes thrice as long
                    evened = np.int32(pixels[c]) * np.int32(EVEN_LIGHT)
                    total += abs(evened - np.int32(scene[c]) * level)
                differences[j] += total
        threshold = limit * EVEN_LIGHT * 3 * CELL_PX * len(sampled)
        for j in range(inside):
            changed[i, j] = differences[j] > threshold
    return changed


@kernel
def _light_at(light: Floats, v: int, u: int) -> Any:
    """Light at row `v`, column `u` [px] of all cells, bilinear between the centres of cells.

    `light` (n + 2, m + 2) is that of the cells and a border of one.
    """
    y = (v + 0.5) / CELL_PX + 0.5
    x = (u + 0.5) / CELL_PX + 0.5
    i, j = int(y), int(x)
    down, right = np.float32(y - i), np.float32(x - j)
    above = light[i, j] + right * (light[i, j + 1] - light[i, j])
    below = light[i + 1, j] + right * (light[i + 1, j + 1] - light[i + 1, j])
    return above + down * (below - above)


@kernel
def _load_cell(
    image: Image,
    background: Image,
    shade: Floats,
    light: Floats,
    corner: tuple[int, int],
    cell: tuple[int, int],
    pixels: Floats,
) -> None:
    """Write seven features of each pixel of one `cell`, row and column, to `pixels` (7, CELL_PX^2).

    0 to 2: B, G, R at even light minus the background's; 3 to 5: the background's; 6: its shade.
    `corner` is the column and row [px] of the first cell; pixels past the image repeat its border.
    """
    for n in range(CELL_PX * CELL_PX):
        v = CELL_PX * cell[0] + n // CELL_PX
        u = CELL_PX * cell[1] + n % CELL_PX
        y = min(corner[1] + v, image.shape[0] - 1)
        x = min(corner[0] + u, image.shape[1] - 1)
        gain = np.float32(EVEN_LIGHT) / _light_at(light, v, u)
        for c in range(3):
            scene = np.float32(background[y, x, c])
            pixels[c, n] = np.float32(image[y, x, c]) * gain - scene
            pixels[3 + c, n] = scene
        pixels[6, n] = shade[y, x]


@kernel
def _shares(pixels: Floats, colours: Floats, variance: Any, shares: Floats) -> None:
    """Write the share of strip in each of `pixels` (7, n) to `shares` (n,).

    It is the largest over the strip's `colours` (k, 3), of those that the scene does not resemble.
    Without branches in the inner loop, so that it is compiled to vectors of pixels.
    """
    d0, d1, d2, s0, s1, s2 = pixels[0], pixels[1], pixels[2], pixels[3], pixels[4], pixels[5]
    shade = pixels[6]
    shares[:] = 0
    for k in range(len(colours)):
        c0, c1, c2 = colours[k, 0], colours[k, 1], colours[k, 2]
        of_strip = c0 * c0 + c1 * c1 + c2 * c2
        for n in range(CELL_PX * CELL_PX):
            of_scene = s0[n] * s0[n] + s1[n] * s1[n] + s2[n] * s2[n]
            along = d0[n] * s0[n] + d1[n] * s1[n] + d2[n] * s2[n]
            mixed = s0[n] * c0 + s1[n] * c1 + s2[n] * c2
            a, b, det = _compiled_fisher(mixed, of_strip, of_scene, shade[n], variance)
            reach = a * (of_strip - mixed) + b * (mixed - of_scene)
            share = (a * (d0[n] * c0 + d1[n] * c1 + d2[n] * c2) + b * along) / reach
            distinct = reach > np.float32(LEAST_SEPARATION * LEAST_SEPARATION) * det
            shares[n] = share if distinct & (share > shares[n]) else shares[n]


@entry
def segment(
    image: Image,
    background: Image,
    shade: Floats,
    light: Floats,
    cells: Image,
    colours: Floats,
    variance: float,
    corner: tuple[int, int],
) -> Image:
    """Matte levels (CELL_PX n, CELL_PX m) of the strip in those `cells` (n, m) that are not 0.

    Other cells have ZERO_LEVEL.
    The images (height, width, 3) and `shade` (height, width) are whole, `light` (n + 2, m + 2)
    that of the cells and a border of one, of which the first inside begins at `corner`, column
    and row [px]. Of `colours` (k, 3) the one counts that a pixel shows most of.
    """
    rows, columns = cells.shape
    levels = np.full((rows * CELL_PX, columns * CELL_PX), ZERO_LEVEL, np.uint8)
    pixels = np.empty((7, CELL_PX * CELL_PX), np.float32)
    shares = np.empty(CELL_PX * CELL_PX, np.float32)
    for i in range(rows):
        for j in range(columns):
            if cells[i, j] == 0:
                continue
            _load_cell(image, background, shade, light, corner, (i, j), pixels)
            _shares(pixels, colours, np.float32(variance), shares)
            for n in range(CELL_PX * CELL_PX):
                level = np.float32(ZERO_LEVEL) + np.float32(LEVEL_SPAN) * shares[n]
                level = min(level + np.float32(0.5), np.float32(255))
                levels[CELL_PX * i + n // CELL_PX, CELL_PX * j + n % CELL_PX] = np.uint8(level)
    return levels


@entry
def silhouette_of(
    levels: Image, strip: Image, lifted: Image, lines: Offsets, solid: int, faint: int
) -> Image:
    """Mask (h, w) of the strip, 255 inside, from matte `levels` (h + n - 1, w + n - 1).

    In the zone `strip` where the levels exceed `solid`, in its part `lifted` also where their mean
    exceeds `faint` along one of `lines` (k, n, 2) of rows and columns. The levels have a border
    that is as wide as the lines reach.
    """
    h, w = strip.shape
    count, length = lines.shape[:2]
    flat = levels.reshape(-1)
    width = levels.shape[1]
    reach = length // 2
    steps = lines[:, :, 0] * width + lines[:, :, 1]
    mask = np.zeros((h, w), np.uint8)
    half = ZERO_LEVEL + (faint - ZERO_LEVEL) // 2
    for v in range(h):
        row = levels[v + reach, reach : reach + w]
        for u in range(w):
            if row[u] <= half or strip[v, u] == 0:
                continue
            if row[u] > solid:
                mask[v, u] = 255
            elif lifted[v, u] != 0:
                pixel = (v + reach) * width + u + reach
                for k in range(count):
                    total = 0
                    for n in range(length):
                        total += flat[pixel + steps[k, n]]
                    if total > faint * length:
                        mask[v, u] = 255
                        break
    return mask
