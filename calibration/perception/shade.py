"""Shadows in a matte: smooth, wide, and not of the strip."""

import cv2
import numpy as np

from calibration.perception.background import ABOUT, CELL
from calibration.perception.matte import SCALE, ZERO
from drivers.types import Image

LEAST, MOST = 0.08, 0.35  # shares of strip that a shadow looks like


def without_shade(levels: Image, lifted: Image) -> Image:
    """Matte levels (h, w) with shadows on the background taken out where `lifted` (h, w) is 255.

    A strip covers less than half of a neighbourhood, whose median is then the background's: a
    shadow where it shows `LEAST` to `MOST` of strip. Levels without any are returned unchanged.
    """
    h, w = levels.shape
    size = (-(-w // CELL), -(-h // CELL))
    cells, high = (
        cv2.resize(part, size, interpolation=cv2.INTER_LINEAR) for part in (levels, lifted)
    )
    median = cv2.medianBlur(cells, ABOUT).astype(np.float32) - ZERO
    known = (high == 255) & (median >= LEAST * SCALE) & (median <= MOST * SCALE)
    shade = np.where(known, median, 0.0)
    if not shade.any():
        return levels
    smooth = cv2.resize(
        cv2.blur(shade.astype(np.float32), (3, 3)), (w, h), interpolation=cv2.INTER_LINEAR
    )
    above = (levels - ZERO - smooth) / (1.0 - smooth / SCALE)
    evened = np.rint(np.clip(ZERO + above, 0, 255)).astype(np.uint8)
    return np.where(lifted > 0, evened, levels)
