"""Appearance learnt before a fold: colours of the strip, background, separation of
both.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from calibration.calibration import Calibration
from cell.perception import kernels
from cell.perception.kernels import CELL_PX, PATCH_PX, Floats, LitImage
from cell.perception.region import Region, Sizes, motion_mask
from cell.perception.resting_strip import face_height, inner_pixels
from drivers.base.types import Array, Image, frozen
from drivers.strip.file import StripFile

MOST_COLOURS = 4  # colours that a strip may have
COLOUR_SPREAD = 6.0  # grey levels by which weave and noise scatter one colour
SHADE = 0.06  # share of brightness by which weave and light vary over a resting strip
OTHER_COLOUR = 3.0  # standard deviations from which a sample is of another colour
BLENDS = 0.08  # share of samples that may lie between colours
ROUNDS = 12

Indices = NDArray[np.signedinteger[Any]]


def _palette(samples: Array) -> Array:
    """Smallest set of colours (k, 3) that explains the colours `samples` (n, 3), the
    most frequent one first.

    At most MOST_COLOURS. Samples between two colours, as at the border of a stripe, may
    stay unexplained.
    """
    colours = np.median(samples, axis=0)[None]
    while len(colours) < MOST_COLOURS:
        unlike_all = colour_distances(samples, colours).min(axis=1) > OTHER_COLOUR
        if unlike_all.mean() <= BLENDS:
            break
        colours = _refine(
            samples, np.vstack([colours, _worst_explained(samples, colours)])
        )

    nearest = colour_distances(samples, colours).argmin(axis=1)
    frequent = np.argsort(-np.bincount(nearest, minlength=len(colours)), kind="stable")
    return frozen(colours[frequent])


def colour_distances(samples: Array, colours: Array) -> Array:
    """Distances (..., k) of `samples` (..., 3) from each of `colours` (k, 3), in
    standard deviations; differences in brightness count less.
    """
    away = samples[..., None, :] - colours
    bright = colours / np.maximum(np.linalg.norm(colours, axis=1), 1.0)[:, None]
    along = (away * bright).sum(axis=-1)
    aside = (away**2).sum(axis=-1) - along**2
    stretch = COLOUR_SPREAD**2 + SHADE**2 * (colours**2).sum(axis=1)
    squared = np.maximum(aside, 0.0) / COLOUR_SPREAD**2 + along**2 / stretch
    distances: Array = np.sqrt(squared)
    return distances


def _worst_explained(samples: Array, colours: Array) -> Array:
    """Median colour (3,) of the twentieth of `samples` (n, 3) closest to the sample
    that is worst explained by `colours` (k, 3).
    """
    distance = colour_distances(samples, colours).min(axis=1)
    worst = samples[np.argmax(distance)]
    near = np.argsort(np.linalg.norm(samples - worst, axis=1), kind="stable")
    return np.median(samples[near[: max(len(samples) // 20, 1)]], axis=0)


def _refine(samples: Array, colours: Array) -> Array:
    """Colours (k, 3) moved to the medians of the `samples` (n, 3) nearest to each of
    them, up to ROUNDS times until they stay.
    """
    for _ in range(ROUNDS):
        nearest: Indices = colour_distances(samples, colours).argmin(axis=1)
        medians = colours.copy()
        for k in np.unique(nearest):
            medians[k] = np.median(samples[nearest == k], axis=0)
        if np.allclose(medians, colours, atol=0.1):
            break
        colours = medians
    return colours


EDGE = 3  # rows of desk that are averaged to either side of the strip
END_MARGIN = 0.012  # m past the strip's free edge that are replaced too
# summed grey levels, to which darker patches are raised: their ratio is noise
DARKEST = 3.0
# share of brightness by which evened light may be off above the desk
LIFTED_SHADE = 0.06
DESK_SHADE = 0.15  # and on it, where the strip throws its own shadow


@dataclass(frozen=True, slots=True)
class Background:
    """Image of the scene without the strip: `image` (height, width, 3) BGR of the whole
    picture.

    `shade` (height, width) is the share of brightness by which the light may still
    differ after it was evened out: more on the desk, where the strip throws its own
    shadow. Light is the median over `about` (odd) by `about` patches.
    """

    image: Image
    shade: Floats
    about: int

    def light(self, image: Image, region: Region, visible: Image) -> Floats:
        """Brightness of `image` relative to the stored background, for each cell of
        `region` and a border of one cell, (n + 2, m + 2).

        EVEN_LIGHT where unchanged since preflight. Shadow and flicker are smooth, a
        strip is thin: the median over a neighbourhood is light only. Pixels where
        `visible` (h, w) is 0, such as the hand, are not used.
        """
        shape = region.cells(PATCH_PX)
        corner = (region.left, region.top)
        before = kernels.patch_brightness(self.image, corner, shape)
        now = kernels.patch_brightness(image, corner, shape)
        ratio = (now / np.maximum(before, DARKEST)).astype(np.float32)
        ratio = self._fill_holes(ratio, _patches_in_view(visible, shape))

        # OpenCV's median is one of whole numbers
        levels = np.rint(np.clip(kernels.EVEN_LIGHT * ratio, 1, 255)).astype(np.uint8)
        median = cv2.medianBlur(levels, self.about).astype(np.float32)
        smooth = cv2.blur(median, (3, 3))

        height, width = (PATCH_PX // CELL_PX * patches for patches in shape)
        cells = cv2.resize(smooth, (width, height))
        n, m = region.cells(CELL_PX)
        border = cv2.BORDER_REPLICATE
        bordered: Floats = cv2.copyMakeBorder(cells[:n, :m], 1, 1, 1, 1, border)
        return bordered

    def _fill_holes(self, values: Floats, known: Floats) -> Floats:
        """Copy of `values` (n, m) in which those not `known` (n, m) are the mean of
        known neighbours, or 1 where there are none.
        """
        size = (3 * self.about, 3 * self.about)
        weight = cv2.blur(known, size)
        mean = cv2.blur(values * known, size) / np.maximum(weight, 1e-6)
        guess = np.where(weight > 1e-4, mean, 1)
        return np.where(known > 0, values, guess).astype(np.float32)


def _patches_in_view(visible: Image, shape: tuple[int, int]) -> Floats:
    """Mask of `shape` (rows, columns) of an image's patches: 0 where the mask `visible`
    (h, w) is 0 in the patch's middle, else 1.
    """
    middles = slice(PATCH_PX // 2, None, PATCH_PX)
    clear = visible[middles, middles] > 0
    in_view = np.ones(shape, np.float32)
    in_view[: clear.shape[0], : clear.shape[1]] = clear
    return in_view


@dataclass(frozen=True, slots=True)
class RestingPlace:
    """Rectangle [m] in the plane of the strip's near edge in which the resting strip
    appears.

    From x = 0 to `length`, between the heights `low` and `high`, its blur and shadow
    included; its midline lies `rise` over the desk's.
    """

    length: float
    rise: float
    low: float
    high: float


def _learn_background(
    image: Image, calibration: Calibration, resting: RestingPlace
) -> Background:
    """Background of `image` (height, width, 3), interpolated over the rectangle
    `resting` in which the strip lies.
    """
    height, width = image.shape[:2]
    x = np.linspace(0.0, resting.length + END_MARGIN, 60)
    on_desk, _ = _image_line(calibration, x, 0.0)
    left = max(int(on_desk[0]), 0)
    right = min(int(on_desk[-1]) + 1, width - 1)
    columns = np.arange(left, right)
    top = np.interp(columns, *_image_line(calibration, x, resting.high))
    bottom = np.interp(columns, *_image_line(calibration, x, resting.low))

    begins = np.maximum(np.floor(top).astype(int), EDGE)
    ends = np.minimum(np.ceil(bottom).astype(int), height - EDGE - 1) + 1
    empty = image.copy()
    for column, begin, end in zip(columns, begins.tolist(), ends.tolist(), strict=True):
        _bridge(empty[:, column], begin, end)

    edge = np.interp(np.arange(width), columns, top) - EDGE
    is_desk = np.arange(height)[:, None] >= edge
    shade = np.where(is_desk, DESK_SHADE, LIFTED_SHADE).astype(np.float32)
    return Background(empty, shade, Sizes.of_camera(calibration).light)


def _image_line(calibration: Calibration, x: Array, z: float) -> tuple[Array, Array]:
    """Image columns and rows (n,) [px] of the points at `x` (n,) [m] and height `z` [m]
    in the plane of the strip's near edge.
    """
    u, v = calibration.to_image(np.insert(x[:, None], 1, z, axis=1)).T
    return u, v


def _bridge(column: Image, begin: int, end: int) -> None:
    """Replace rows `begin` to before `end` of the image `column` (h, 3) by a straight
    transition between the rows beside them.
    """
    if begin + 1 < end:
        above = column[begin - EDGE : begin].mean(axis=0)
        below = column[end : end + EDGE].mean(axis=0)
        share = np.arange(1, end - begin + 1)[:, None] / (end - begin + 1)
        column[begin:end] = np.rint(above + share * (below - above))


# grey levels, assumed of any camera: weave, demosaicing and rounding add to it
LEAST_NOISE = 2.5
GAUSSIAN = (2 / np.pi) ** 0.5  # mean absolute value over standard deviation
# times the noise's mean difference in a cell, from which the cell changed
CHANGE_RATIO = 1.2
DIFFERENCE = 2**0.5  # of two noisy pictures: the background is one too
NOISE_SHARE = 0.5  # of its noise is left in a picture after `smooth_matte`
AVERAGING_WINDOW = 5  # px over which a picture is averaged to leave its noise
SCALE_ENDS = (20, 235)  # grey levels beyond which a camera clips its noise


@dataclass(frozen=True, slots=True)
class Segmenter:
    """Separation of the strip from its background, by the `colours` (k, 3) BGR of the
    strip.

    `sensor` [grey levels] is the standard deviation of a pixel's difference from the
    background, `smooth` the same after smoothing, `noise` that of a pixel's share of
    strip.
    """

    colours: Array
    background: Background
    sensor: float
    smooth: float
    noise: float

    def levels(
        self, image: Image, region: Region, visible: Image
    ) -> tuple[Image, Region]:
        """Grey levels (h, w) that state how much strip is in each pixel of `image`
        (height, width, 3), and the region that they cover.

        That is the part of `region`, in whole cells, that holds all but background.
        Only cells that differ from the background in this light, and their neighbours,
        are compared with the strip's colours. Pixels masked out by `visible`, of the
        region's size, are background.
        """
        image = np.ascontiguousarray(image)
        light = self.background.light(image, region, visible)
        cells = self._changed_cells(image, light, region)

        column, row, columns, rows = cv2.boundingRect(cells)
        left, top = CELL_PX * column, CELL_PX * row  # px in the region
        part = Region(
            left=region.left + left,
            top=region.top + top,
            right=min(region.left + left + CELL_PX * columns, region.right),
            bottom=min(region.top + top + CELL_PX * rows, region.bottom),
        )
        part_light = light[row : row + rows + 2, column : column + columns + 2]
        part_cells = cells[row : row + rows, column : column + columns]

        picture = LitImage(
            image=image,
            background=self.background.image,
            shade=self.background.shade,
            light=np.ascontiguousarray(part_light),
            corner=(part.left, part.top),
        )
        levels = kernels.segment(
            picture,
            np.ascontiguousarray(part_cells),
            _floats(self.colours),
            self.smooth**2,
        )

        height = part.bottom - part.top
        width = part.right - part.left
        clear = visible[top : top + height, left : left + width]
        shown = cv2.min(levels[:height, :width], clear)
        return cv2.max(shown, kernels.ZERO_LEVEL), part

    def _changed_cells(self, image: Image, light: Floats, region: Region) -> Image:
        """Mask (n, m) of the cells of `region` that differ from the background, and of
        their neighbours.
        """
        height = image.shape[0]
        changed = kernels.changed_cells(
            image.reshape(height, -1),
            self.background.image.reshape(height, -1),
            np.rint(light[1:-1, 1:-1]).astype(np.uint8),
            (region.left, region.top),
            CHANGE_RATIO * GAUSSIAN * self.sensor,
        )
        cells: Image = cv2.dilate(changed, np.ones((3, 3), np.uint8))
        cells[0, 0] |= not cells.any()  # never an empty part
        return cells

    def separation(self, where: Image) -> Floats:
        """Separation (k, n) of each of the k strip colours from the background in the n
        pixels of the mask `where`, in standard deviations of noise.
        """
        scene = self.background.image[where > 0]
        shade = self.background.shade[where > 0]
        return np.stack(
            [separation(c, scene, shade, self.smooth) for c in self.colours]
        )


def separation(
    colour: Array, scene: Array | Image, shade: Floats, sensor: float
) -> Floats:
    """Separation (n,) of the strip's `colour` (3,) from the background colours `scene`
    (n, 3), in standard deviations of noise.
    """
    return np.sqrt(
        kernels.discriminants(_floats(colour), _floats(scene), shade, sensor**2)[0]
    )


def learn_segmenter(
    image: Image,
    noise: float,
    calibration: Calibration,
    strip: StripFile,
    resting: RestingPlace,
) -> Segmenter:
    """Learn to tell the strip from its background, from an `image` (height, width, 3)
    in which it lies in the rectangle `resting`.

    `noise` [grey levels] is that of the image.
    """
    sensor = max(noise, LEAST_NOISE) * DIFFERENCE
    smooth = max(sensor * NOISE_SHARE, LEAST_NOISE * DIFFERENCE)
    background = _learn_background(image, calibration, resting)
    colours = _palette(inner_pixels(image, calibration, strip, resting.rise))
    scene = background.image[motion_mask(calibration, strip.length) > 0]
    noise_of_share = _share_noise(colours, scene, smooth) * sensor
    return Segmenter(
        colours=colours,
        background=background,
        sensor=sensor,
        smooth=smooth,
        noise=noise_of_share,
    )


def resting_place(
    calibration: Calibration, strip: StripFile, rise: float, margin: float
) -> RestingPlace:
    """Rectangle in which `strip` appears at rest, `rise` [m] above the desk, with
    `margin` [m] above and below it.
    """
    half = strip.thickness / 2
    top = half + face_height(calibration, strip)
    return RestingPlace(
        length=strip.length,
        rise=rise,
        low=rise - half - margin,
        high=rise + top + margin,
    )


def sensor_noise(image: Image) -> float:
    """Standard deviation [grey levels] of the sensor noise in `image` (h, w, 3).

    The median over cells of the deviation from a moving average. Cells at either end of
    the scale are left out, since they show none.
    """
    pixels = image.astype(np.float32)
    noise = pixels - cv2.blur(pixels, (AVERAGING_WINDOW, AVERAGING_WINDOW))
    size = (image.shape[1] // CELL_PX, image.shape[0] // CELL_PX)
    power = cv2.resize(noise * noise, size, interpolation=cv2.INTER_AREA)
    level = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    inside = power[(level > SCALE_ENDS[0]) & (level < SCALE_ENDS[1])]
    if len(inside) == 0:
        return 0.0

    # a pixel weighs in its own average, which takes that share of its variance away
    variance = np.median(inside) / (1 - AVERAGING_WINDOW**-2)
    return float(np.sqrt(variance))


def _share_noise(colours: Array, background: Image, smooth: float) -> float:
    """Noise of the fraction of strip in a pixel, per grey level of sensor noise, for
    the strip's worst colour.

    `colours` (k, 3) are the strip's, `background` (n, 3) those of the scene.
    """
    scene = _floats(background)
    worst = 0.0
    shade = np.full(len(scene), LIFTED_SHADE, dtype=np.float32)
    for colour in _floats(colours):
        reach, size = kernels.discriminants(colour, scene, shade, smooth**2)
        distinct = reach > kernels.LEAST_SEPARATION**2
        if distinct.any():
            worst = max(worst, np.median(size[distinct] / reach[distinct]))
    return worst


def _floats(values: Array | Image | Floats) -> Floats:
    """Contiguous copy of `values` in single precision, as the kernels take them."""
    return np.ascontiguousarray(values, dtype=np.float32)


@dataclass(frozen=True, slots=True)
class Appearance:
    """Appearance learnt before a fold: in `scene` how to tell the strip from its
    background, and the height of the resting strip.

    `resting_line` (k,) are polynomial coefficients, constant first, of the resting
    midline's height [m] over x [m] as the homography maps it.
    """

    scene: Segmenter
    resting_line: Array

    def rest_height(self, x: Array) -> Array:
        """Height (n,) [m] of the resting midline at x (n,) [m]."""
        return np.asarray(polyval(x, self.resting_line))
