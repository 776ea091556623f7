"""Compiled loops over pixels: which cells have changed, how much strip is in each
pixel, and the strip's mask.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base.jit import entry, kernel
from drivers.base.types import Array, Image

ZERO_LEVEL = 48  # grey level of all background
LEVEL_SPAN = 160  # grey levels from there to all strip


def smooth_matte(levels: Image) -> Image:
    """Smooth `levels` (h, w), grey levels that state how much strip is in each pixel,
    to half their noise.
    """
    smooth: Image = cv2.GaussianBlur(levels, (3, 3), 0)
    return smooth


def strip_share(levels: Array | Image) -> Array:
    """Convert grey levels that state how much strip is in each pixel to fractions, 0 to
    1 and slightly beyond, in the same shape.
    """
    return (np.asarray(levels, dtype=np.float64) - ZERO_LEVEL) / LEVEL_SPAN


CELL_PX = 8  # px, side of a cell, by which change is detected
FIRST_ROW, ROW_STEP = 1, 4  # px, the rows of a cell that are compared
PATCH_PX = 2 * CELL_PX  # px, side of a patch, by which light is read
# px, rows and columns of a patch that are read
LIT_PX = (PATCH_PX // 2 - 3, PATCH_PX // 2 + 1)
EVEN_LIGHT = 120  # level of light as bright as at preflight
SHADE = 0.15  # relative change of the strip's brightness as it bends
# separation below which a colour cannot be distinguished from the background
LEAST_SEPARATION = 2.0

Floats = NDArray[np.float32]
Offsets = NDArray[np.int64]


class LitImage(NamedTuple):
    """Image of the cell, with the learnt background and its shade, and the present
    brightness of the light.

    `image`, `background` (height, width, 3) BGR and the background's `shade` (height,
    width) are whole. `light` (n + 2, m + 2) is that of n by m cells and of a border of
    one; the first cell inside begins at `corner`, column and row [px].
    """

    image: Image
    background: Image
    shade: Floats
    light: Floats
    corner: tuple[int, int]


def _fisher(
    strip_scene: Any, strip_strip: Any, scene_scene: Any, shade: Any, variance: Any
) -> tuple[Any, Any, Any]:
    """Factors a, b, det of Fisher's discriminant w = (a c + b s) / det between a
    strip's colour c and a scene's colour s.

    w = S^-1 (c - s), with the scatter S = variance I + SHADE^2 c c' + shade^2 s s' of
    sensor, strip and scene. The first three
    arguments are the products c's, c'c and s's.
    """
    strip_shade = np.float32(SHADE * SHADE)
    strip_scatter = variance + strip_shade * strip_strip
    scene_scatter = variance + shade * shade * scene_scene
    cross = np.float32(SHADE) * shade * strip_scene
    a = scene_scatter + strip_shade * strip_scene
    b = -(strip_scatter + shade * shade * strip_scene)
    return a, b, strip_scatter * scene_scatter - cross * cross


_compiled_fisher = kernel(_fisher)


def discriminants(
    colour: Floats, scene: Floats, shade: Floats, variance: float
) -> tuple[Floats, Floats]:
    """Squared separation (n,) [sigma^2] of a strip's `colour` (3,) from the colours
    `scene` (n, 3) of its background.

    The brightness of the scene may differ by the share `shade` (n,); `variance` is the
    sensor's [grey levels squared]. Also returns the length (n,) [1/grey level] of
    Fisher's discriminant w of `_fisher`.
    """
    strip_scene = (scene * colour).sum(axis=1)
    strip_strip = (colour * colour).sum()
    scene_scene = (scene * scene).sum(axis=1)
    products = (strip_scene, strip_strip, scene_scene)
    of_strip, of_scene, det = _fisher(*products, shade, np.float32(variance))
    apart = of_strip * (strip_strip - strip_scene) + of_scene * (
        strip_scene - scene_scene
    )
    w = (of_strip / det)[:, None] * colour + (of_scene / det)[:, None] * scene
    return np.maximum(apart / det, 0), np.sqrt((w * w).sum(axis=1))


@kernel
def _patch_brightness(image: Image, row: int, column: int) -> Any:
    """Mean of the pixels LIT_PX of the patch at `row`, `column` [px], summed over the
    channels.
    """
    total = np.int32(0)
    for down in LIT_PX:
        v = min(row + down, image.shape[0] - 1)
        for right in LIT_PX:
            u = min(column + right, image.shape[1] - 1)
            for channel in range(3):
                total += np.int32(image[v, u, channel])
    return np.float32(total) / (len(LIT_PX) * len(LIT_PX))


@entry
def patch_brightness(
    image: Image, corner: tuple[int, int], shape: tuple[int, int]
) -> Floats:
    """Brightness (rows, columns) = `shape` of patches of `image` (h, w, 3), summed over
    channels.

    The first patch begins at `corner`, column and row [px].
    """
    patches = np.empty(shape, np.float32)
    for i in range(shape[0]):
        for j in range(shape[1]):
            row = corner[1] + PATCH_PX * i
            column = corner[0] + PATCH_PX * j
            patches[i, j] = _patch_brightness(image, row, column)
    return patches


@kernel
def _add_differences(
    pixels: Image, scene: Image, light: Image, differences: Any
) -> None:
    """Add to `differences` (m,) how far the m cells in one row of `pixels` (3 w,) are
    from the background `scene`.

    Summed over CELL_PX pixels and three channels, EVEN_LIGHT times as large, at the
    cells' `light`.
    """
    for j in range(len(differences)):
        level = np.int32(light[j])
        difference = np.int32(0)
        for c in range(3 * CELL_PX * j, 3 * CELL_PX * (j + 1)):
            evened = np.int32(pixels[c]) * np.int32(EVEN_LIGHT)
            difference += abs(evened - np.int32(scene[c]) * level)
        differences[j] += difference


@entry
def changed_cells(
    image: Image, background: Image, light: Image, corner: tuple[int, int], limit: float
) -> Image:
    """Mask (n, m) of image cells that differ from the background: 1 where changed, else
    0.

    Images (h, 3 w) are B, G, R in turn; `light` (n, m) is the cells', the first of
    which begins at `corner`, column and row [px]. Changed is one whose mean over every
    ROW_STEP-th row differs by more than `limit` [grey levels] per channel; one that the
    right border cuts never is.
    """
    rows, columns = light.shape
    left, top = corner
    changed = np.zeros((rows, columns), np.uint8)
    whole_columns = min(columns, (image.shape[1] // 3 - left) // CELL_PX)

    for i in range(rows):
        begin = top + CELL_PX * i
        compared_rows = range(
            begin + FIRST_ROW, min(begin + CELL_PX, image.shape[0]), ROW_STEP
        )
        differences = np.zeros(whole_columns, np.int32)
        for v in compared_rows:
            pixels = image[v, 3 * left :]
            scene = background[v, 3 * left :]
            _add_differences(pixels, scene, light[i], differences)
        threshold = limit * EVEN_LIGHT * 3 * CELL_PX * len(compared_rows)
        changed[i, :whole_columns] = differences > threshold
    return changed


@kernel
def _light_at(light: Floats, v: int, u: int) -> Any:
    """Brightness of the light at row `v`, column `u` [px], interpolated between the
    centres of cells.

    `light` (n + 2, m + 2) is that of the cells and a border of one.
    """
    y = (v + 0.5) / CELL_PX + 0.5
    x = (u + 0.5) / CELL_PX + 0.5
    i = int(y)
    j = int(x)
    down = np.float32(y - i)
    right = np.float32(x - j)
    upper = light[i]
    lower = light[i + 1]
    above = upper[j] + right * (upper[j + 1] - upper[j])
    below = lower[j] + right * (lower[j + 1] - lower[j])
    return above + down * (below - above)


@kernel
def _load_cell(picture: Any, row: int, column: int, pixels: Floats) -> None:
    """Write seven features of each pixel of the cell at `row`, `column` into `pixels`
    (7, CELL_PX^2).

    0 to 2: B, G, R at even light minus the background's; 3 to 5: the background's; 6:
    its shade. Pixels past the image repeat its border.
    """
    height, width = picture.shade.shape
    for n in range(CELL_PX * CELL_PX):
        v = CELL_PX * row + n // CELL_PX
        u = CELL_PX * column + n % CELL_PX
        y = min(picture.corner[1] + v, height - 1)
        x = min(picture.corner[0] + u, width - 1)
        gain = np.float32(EVEN_LIGHT) / _light_at(picture.light, v, u)

        for channel in range(3):
            scene = np.float32(picture.background[y, x, channel])
            pixels[channel, n] = np.float32(picture.image[y, x, channel]) * gain - scene
            pixels[3 + channel, n] = scene

        pixels[6, n] = picture.shade[y, x]


@kernel
def _shares(pixels: Floats, colours: Floats, variance: Any, shares: Floats) -> None:
    """Write into `shares` (n,) the fraction of strip in each of n pixels, from their
    seven features `pixels` (7, n).

    With p a pixel's colour it is w'(p - s) / w'(c - s), w the discriminant of
    `_fisher`: the largest over the strip's `colours` (k, 3), of those that the scene
    does not resemble. Without branches in the inner loop, so that it is compiled to
    vectors of pixels.
    """
    over_b = pixels[0]
    over_g = pixels[1]
    over_r = pixels[2]
    back_b = pixels[3]
    back_g = pixels[4]
    back_r = pixels[5]
    shade = pixels[6]

    shares[:] = 0
    for k in range(len(colours)):
        b = colours[k, 0]
        g = colours[k, 1]
        r = colours[k, 2]
        strip_strip = b * b + g * g + r * r
        for n in range(CELL_PX * CELL_PX):
            scene_scene = (
                back_b[n] * back_b[n] + back_g[n] * back_g[n] + back_r[n] * back_r[n]
            )
            over_scene = (
                over_b[n] * back_b[n] + over_g[n] * back_g[n] + over_r[n] * back_r[n]
            )
            strip_scene = back_b[n] * b + back_g[n] * g + back_r[n] * r
            over_strip = over_b[n] * b + over_g[n] * g + over_r[n] * r
            of_strip, of_scene, det = _compiled_fisher(
                strip_scene, strip_strip, scene_scene, shade[n], variance
            )
            apart = of_strip * (strip_strip - strip_scene) + of_scene * (
                strip_scene - scene_scene
            )
            share = (of_strip * over_strip + of_scene * over_scene) / apart
            distinct = apart > np.float32(LEAST_SEPARATION * LEAST_SEPARATION) * det
            shares[n] = share if distinct & (share > shares[n]) else shares[n]


@entry
def segment(picture: LitImage, cells: Image, colours: Floats, variance: float) -> Image:
    """Grey levels (CELL_PX n, CELL_PX m) that state how much strip is in each pixel, in
    those of n by m image `cells` that are not 0.

    Other cells have ZERO_LEVEL. Of the strip's `colours` (k, 3) the one counts that a
    pixel shows most of; `variance` [grey levels squared] is the sensor's.
    """
    rows, columns = cells.shape
    levels = np.full((rows * CELL_PX, columns * CELL_PX), ZERO_LEVEL, np.uint8)
    pixels = np.empty((7, CELL_PX * CELL_PX), np.float32)
    shares = np.empty(CELL_PX * CELL_PX, np.float32)
    for i in range(rows):
        for j in range(columns):
            if cells[i, j] == 0:
                continue
            _load_cell(picture, i, j, pixels)
            _shares(pixels, colours, np.float32(variance), shares)
            for n in range(CELL_PX * CELL_PX):
                level = np.float32(ZERO_LEVEL) + np.float32(LEVEL_SPAN) * shares[n]
                level = min(level + np.float32(0.5), np.float32(255))
                levels[CELL_PX * i + n // CELL_PX, CELL_PX * j + n % CELL_PX] = (
                    np.uint8(level)
                )

    return levels


@kernel
def _lies_on_line(levels: Any, pixel: int, steps: Offsets, faint: int) -> bool:
    """Whether `levels`, a flat image of how much strip is in each pixel, exceed `faint`
    in the mean over a line of pixels through `pixel`.

    A line is a row of `steps` (k, n) from the pixel.
    """
    for line in range(steps.shape[0]):
        total = 0
        for n in range(steps.shape[1]):
            total += levels[pixel + steps[line, n]]
        if total > faint * steps.shape[1]:
            return True
    return False


@entry
def silhouette_of(
    levels: Image, strip: Image, lifted: Image, lines: Offsets, solid: int, faint: int
) -> Image:
    """Mask (h, w) of the strip, 255 inside, from `levels` (h + n - 1, w + n - 1), which
    state how much strip is in each pixel.

    In the zone `strip` where the levels exceed `solid`, in its part `lifted` also where
    their mean exceeds `faint` along one of `lines` (k, n, 2) of rows and columns. The
    levels have a border that is as wide as the lines reach.
    """
    height, width = strip.shape
    reach = lines.shape[1] // 2
    stride = levels.shape[1]
    flat_levels = levels.reshape(-1)
    flat_steps = lines[:, :, 0] * stride + lines[:, :, 1]
    # of a pixel, whatever lies around it
    least_level = ZERO_LEVEL + (faint - ZERO_LEVEL) // 2

    mask = np.zeros((height, width), np.uint8)
    for v in range(height):
        row = levels[v + reach, reach : reach + width]
        for u in range(width):
            if row[u] <= least_level or strip[v, u] == 0:
                continue
            pixel = (v + reach) * stride + u + reach
            if row[u] > solid or (
                lifted[v, u] != 0
                and _lies_on_line(flat_levels, pixel, flat_steps, faint)
            ):
                mask[v, u] = 255

    return mask
