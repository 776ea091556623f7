"""Segmentation of the strip in a scene of any colours, learnt from one image before the fold."""

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.calibration import Calibration
from cell.perception.background import LIFTED_SHADE, Background, Place, learn_background
from cell.perception.kernels import (
    CELL_PX,
    LEAST_SEPARATION,
    PATCH_PX,
    Floats,
    changed_cells,
    discriminants,
    segment,
)
from cell.perception.levels import ZERO_LEVEL
from cell.perception.palette import palette
from cell.perception.region import Region, motion_mask
from cell.perception.resting import face_height
from cell.perception.sizes import Sizes
from drivers.strip.file import StripFile
from drivers.types import Array, Image

LEAST_NOISE = 2.5  # grey levels, assumed of any camera: weave, demosaicing and rounding add to it
GAUSSIAN = (2 / np.pi) ** 0.5  # mean absolute value over standard deviation
CHANGE_RATIO = 1.2  # times the noise's mean difference in a cell, from which the cell changed
DIFFERENCE = 2**0.5  # of two noisy pictures: the background is one too
NOISE_SHARE = 0.5  # of its noise is left in a picture after `soft`
AVERAGING_WINDOW = 5  # px over which a picture is averaged to leave its noise
SCALE_ENDS = (20, 235)  # grey levels beyond which a camera clips its noise


@dataclass(frozen=True, slots=True)
class Segmenter:
    """Segmentation model of a scene: `colours` (k, 3) BGR of the strip, and the `background`.

    `sensor` [grey levels] is the noise of a pixel's difference from the background, `smooth` what
    is left of it where borders are read, `noise` that of the pixel's share of strip: standard
    deviations.
    """

    colours: Array
    background: Background
    sensor: float
    smooth: float
    noise: float

    def levels(self, image: Image, region: Region, visible: Image) -> tuple[Image, Region]:
        """Matte levels (h, w) of the strip in `image` (height, width, 3), and their region.

        That is the part of `region`, in whole cells, that holds all but background. Only cells
        that differ from the background in this light, and their neighbours, are compared with the
        strip's colours. Pixels masked out by `visible`, of the region's size, are background.
        """
        image = np.ascontiguousarray(image)
        light = self.background.light(image, region, visible)
        cells = self._changed_cells(image, light, region)
        j, i, columns, rows = cv2.boundingRect(cells)
        part = Region(
            region.left + CELL_PX * j,
            region.top + CELL_PX * i,
            min(region.left + CELL_PX * (j + columns), region.right),
            min(region.top + CELL_PX * (i + rows), region.bottom),
        )
        found = segment(
            image,
            self.background.image,
            self.background.shade,
            np.ascontiguousarray(light[i : i + rows + 2, j : j + columns + 2]),
            np.ascontiguousarray(cells[i : i + rows, j : j + columns]),
            _floats(self.colours),
            self.smooth**2,
            (part.left, part.top),
        )
        h, w = part.bottom - part.top, part.right - part.left
        clear = visible[CELL_PX * i : CELL_PX * i + h, CELL_PX * j : CELL_PX * j + w]
        return cv2.max(cv2.min(found[:h, :w], clear), ZERO_LEVEL), part

    def _changed_cells(self, image: Image, light: Floats, region: Region) -> Image:
        """Mask (n, m) of the cells that differ from the background, and of their neighbours."""
        height = image.shape[0]
        cells = changed_cells(
            image.reshape(height, -1),
            self.background.image.reshape(height, -1),
            np.rint(light[1:-1, 1:-1]).astype(np.uint8),
            region.left,
            region.top,
            CHANGE_RATIO * GAUSSIAN * self.sensor,
        )
        cells = cv2.dilate(cells, np.ones((3, 3), np.uint8))
        cells[0, 0] |= not cells.any()  # never an empty part
        return np.asarray(cells)

    def separation(self, where: Image) -> Floats:
        """Separation (k, n) [sigma] of the k colours from the background in the mask's n pixels."""
        behind, shade = self.background.image[where > 0], self.background.shade[where > 0]
        return np.stack([separation(c, behind, shade, self.smooth) for c in self.colours])


def separation(colour: Array, scene: Array | Image, shade: Floats, sensor: float) -> Floats:
    """Separation (n,) of `colour` (3,) from scene colours (n, 3), in standard deviations."""
    found = discriminants(_floats(colour), _floats(scene), shade, sensor**2)
    return np.sqrt(found[:, 2])


def learn(
    image: Image,
    noise: float,
    samples: Array,
    calibration: Calibration,
    strip: StripFile,
    place: Place,
) -> Segmenter:
    """Learn the segmentation model from `image` (h, w, 3) with the strip at `place`.

    `samples` (n, 3) are pixels of the strip, `noise` [grey levels] is that of the image.
    """
    sensor = max(noise, LEAST_NOISE) * DIFFERENCE
    smooth = max(sensor * NOISE_SHARE, LEAST_NOISE * DIFFERENCE)
    about = Sizes.of(calibration, PATCH_PX).light
    behind = learn_background(image, calibration, place, about)
    colours, scene = palette(samples), behind.image[motion_mask(calibration, strip.length) > 0]
    return Segmenter(colours, behind, sensor, smooth, _share_noise(colours, scene, smooth) * sensor)


def resting_place(calibration: Calibration, strip: StripFile, rise: float, margin: float) -> Place:
    """Place where `strip` rests, its midline `rise` [m] over the desk's, with a `margin` [m]."""
    half = strip.thickness / 2
    top = half + face_height(calibration, strip)
    return Place(strip.length, rise, rise - half - margin, rise + top + margin)


def sensor_noise(image: Image) -> float:
    """Standard deviation [grey levels] of the sensor noise in `image` (h, w, 3).

    The median over cells of the deviation from a moving average. Cells at either end of the scale
    are left out, since they show none.
    """
    seen = image.astype(np.float32)
    rest = seen - cv2.blur(seen, (AVERAGING_WINDOW, AVERAGING_WINDOW))
    size = (image.shape[1] // CELL_PX, image.shape[0] // CELL_PX)
    power = cv2.resize(rest * rest, size, interpolation=cv2.INTER_AREA)
    level = cv2.resize(seen, size, interpolation=cv2.INTER_AREA)
    good = power[(level > SCALE_ENDS[0]) & (level < SCALE_ENDS[1])]
    return float(np.sqrt(np.median(good) / (1 - AVERAGING_WINDOW**-2))) if len(good) else 0.0


def _share_noise(colours: Array, behind: Image, smooth: float) -> float:
    """Noise of a pixel's share of strip per grey level of sensor noise, for the worst colour.

    `colours` (k, 3) are the strip's, `behind` (n, 3) those of the scene.
    """
    scene, worst = _floats(behind), 0.0
    shade = np.full(len(scene), LIFTED_SHADE, dtype=np.float32)
    for colour in _floats(colours):
        _, _, reach, size = discriminants(colour, scene, shade, smooth**2).T
        distinct = reach > LEAST_SEPARATION**2
        if distinct.any():
            worst = max(worst, float(np.median(size[distinct] / reach[distinct])))
    return worst


def _floats(values: Array | Image | Floats) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float32)
