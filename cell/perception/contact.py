"""Desk contact in an image: where the strip ends along the line of its resting
underside.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.calibration import Calibration
from cell.perception.kernels import LEVEL_SPAN, ZERO_LEVEL, strip_share
from cell.perception.region import STRIP_START
from cell.perception.scene import Appearance
from drivers.base.types import Array, Image
from drivers.strip.file import StripFile
from drivers.strip.model import CONTACT_HEIGHT
from drivers.strip.shape import LYING_LENGTH

SAMPLE_SPACING = 0.0003  # m between samples along the line
FRONT_HEIGHT = -0.005  # m of height where desk shows before the strip
FRONT_STRIDE = 20  # samples of the line to a point in front of it, every 6 mm
AVERAGE = 9  # samples over which a sample is averaged against noise
# samples of strip that must come before, and of desk that must follow: 4 mm
SURE_COUNT = 13
HALF_LEVEL = ZERO_LEVEL + LEVEL_SPAN // 2  # level of which half is strip


@dataclass(frozen=True, slots=True)
class SearchLine:
    """Line of sample points along the strip's underside, on which the desk contact is
    searched.

    `x` (n,) [m] and raw image points `pixels` (n, 2), projected once; `front` (k, 2)
    [px] lie on the desk in front of the strip, where no strip can be.
    """

    x: Array
    pixels: Array
    front: Array

    @classmethod
    def under(
        cls, strip: StripFile, calibration: Calibration, appearance: Appearance
    ) -> "SearchLine":
        """Search line along the underside of `strip` where it stands CONTACT_HEIGHT
        up.
        """
        x = np.arange(STRIP_START + 0.0005, strip.length + 0.01, SAMPLE_SPACING)
        z = appearance.rest_height(x) + CONTACT_HEIGHT - strip.thickness / 2
        # some points in front of the strip's fixed half
        near = x[: len(x) // 2 : FRONT_STRIDE]
        front = np.column_stack([near, np.full_like(near, FRONT_HEIGHT)])
        pixels = calibration.to_image(np.column_stack([x, z]))
        return cls(x, pixels, calibration.to_image(front))


@dataclass(frozen=True, slots=True)
class Contact:
    """Desk contact, where the strip leaves the desk: `x` [m], NaN if hidden; confidence
    0 to 1.
    """

    x: float
    confidence: float


def find_contact(levels: Image, line: SearchLine, origin: Array) -> Contact:
    """Find the desk contact: the last point along `line` at which the lying strip ends.

    As `drivers.strip.shape.desk_contact` defines it, so that a hump over a crease is no
    contact. In images that are shifted the line begins beside the strip, and crosses
    its end.
    `levels` (h, w) is the smoothed matte of the window whose first pixel is `origin`
    (2,) [px].
    """
    desk = _sample(levels, line.front - origin)
    if (desk > HALF_LEVEL).mean() > 0.5:  # all looks like strip
        return Contact(float("nan"), 0.0)
    along = strip_share(_average(_sample(levels, line.pixels - origin)))
    strip = along > 0.5
    ends = _piece_ends(strip)
    if len(ends) == 0 or not strip[: len(strip) // 8].any():
        return Contact(float("nan"), 0.0)
    i = _lying_end(ends, np.flatnonzero(strip))
    if i == len(strip) - 1:
        return Contact(float(line.x[-1]), 1.0)
    part = (along[i] - 0.5) / max(along[i] - along[i + 1], 1e-6)
    confidence = _sharpness(along, i, 4 * SURE_COUNT)
    return Contact(float(line.x[i] + part * SAMPLE_SPACING), confidence)


def _piece_ends(strip: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Indices (k,) at which pieces of strip end in the mask `strip` (n,), and its last
    index.
    """
    # in the run up to each sample
    counts = np.convolve(strip, np.ones(SURE_COUNT), mode="full")
    before = counts[: len(strip)]
    following = counts[SURE_COUNT - 1 :]
    sure = (before[:-1] >= SURE_COUNT - 1) & (following[1:] == 0)
    return np.flatnonzero(strip & np.append(sure & ~strip[1:], True))


def _lying_end(ends: NDArray[np.int64], strip: NDArray[np.int64]) -> int:
    """Last sample of the last piece of strip that is at least LYING_LENGTH long.

    Pieces end at the samples `ends` (k,), of `strip` (n,) that show strip; else that of
    the first.
    """
    begins = strip[np.searchsorted(strip, ends[:-1] + 1)]
    lying = ends[1:][(ends[1:] - begins) * SAMPLE_SPACING >= LYING_LENGTH]
    return int(np.append(ends[0], lying)[-1])


def _sharpness(along: Array, end: int, reach: int) -> float:
    """Confidence, 0 to 1, that strip ends after sample `end`, by the step in strip
    `along` (n,).

    It is 0 for a step of 0.3, and 1 for 0.8, over `reach` samples to either side.
    """
    before = along[max(end - reach, 0) : end + 1].max()
    after = along[end + 1 : end + reach].min()
    return float(np.clip(2 * (before - after) - 0.6, 0.0, 1.0))


def _sample(levels: Image, pixels: Array) -> Image:
    """Grey levels (n,) of `levels` (h, w) at `pixels` (n, 2), ZERO_LEVEL outside."""
    at = pixels.astype(np.float32)[None]
    sampled: Image = cv2.remap(
        levels, at, None, cv2.INTER_LINEAR, borderValue=ZERO_LEVEL
    )
    return sampled.ravel()


def _average(values: Image) -> Array:
    """Moving average (n,) of `values` (n,) over AVERAGE samples, the ends repeated."""
    samples = values[None].astype(np.float64)
    mean: Array = cv2.blur(samples, (AVERAGE, 1), borderType=cv2.BORDER_REPLICATE)[0]
    return mean
