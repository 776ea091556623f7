"""Grey levels of a matte: the share of strip in each pixel."""

import cv2
import numpy as np

from drivers.types import Array, Image

ZERO_LEVEL, LEVEL_SPAN = 48, 160  # grey levels: all background, and from there to all strip


def soft(levels: Image) -> Image:
    """Matte levels (h, w), smoothed to half the noise without moving borders."""
    return np.asarray(cv2.GaussianBlur(levels, (3, 3), 0), dtype=np.uint8)


def share(levels: Array | Image) -> Array:
    """Shares of strip (...,) from matte grey levels (...,): 0 to 1 and slightly beyond."""
    return np.asarray((np.asarray(levels, dtype=np.float64) - ZERO_LEVEL) / LEVEL_SPAN)
