"""Detection of the calibration pin in an image: a bright disc on a dark plate."""

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base.types import Array, Image

# grey levels of the darkest channel of a lit disc, and of one in shadow
LIT_LEVELS = (170, 110)
CONTRAST = 90.0  # grey levels between disc and plate
RADII = (3.0, 30.0)  # px, range of radii of the disc
ROUND = 0.75  # share of its circumscribed circle that the disc fills
WINDOW_REACH, PLATE_EDGE, INSIDE = 1.7, 1.25, 0.7  # over the disc's radius
DARK_SHARE = 0.1  # of the contrast, brightness above the plate that carries no weight


def find_pointer(image: Image) -> Array | None:
    """Centre (2,) u, v [px] of the pin's disc in `image` (h, w, 3); None unless exactly
    one.
    """
    darkest = cv2.min(cv2.min(image[..., 0], image[..., 1]), image[..., 2])
    for level in LIT_LEVELS:
        _, bright = cv2.threshold(darkest, level, 255, cv2.THRESH_BINARY)
        outlines, _ = cv2.findContours(bright, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        discs = [_disc(darkest, outline) for outline in outlines]
        centres = [centre for centre in discs if centre is not None]
        if centres:
            return centres[0] if len(centres) == 1 else None
    return None


def _disc(grey: Image, outline: NDArray[np.int32]) -> Array | None:
    """Centre (2,) u, v [px] of the disc in `outline`, or None without a disc on a dark
    plate.
    """
    (u, v), radius = cv2.minEnclosingCircle(outline)
    if not RADII[0] <= radius <= RADII[1]:
        return None
    if cv2.contourArea(outline) < ROUND * np.pi * (radius - 0.5) ** 2:
        return None

    reach = int(np.ceil(WINDOW_REACH * radius)) + 2
    left, top = round(u) - reach, round(v) - reach
    side = 2 * reach + 1
    window = grey[max(top, 0) : top + side, max(left, 0) : left + side]
    if window.shape != (side, side):
        return None

    dv, du = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    distance = np.hypot(du - (u - round(u)), dv - (v - round(v)))
    on_plate = (distance > PLATE_EDGE * radius + 1) & (distance < reach)
    plate = float(np.median(window[on_plate]))
    disc = float(np.median(window[distance < INSIDE * radius]))
    if disc - plate < CONTRAST:
        return None

    share = (window - plate) / (disc - plate)
    weight = np.clip(share - DARK_SHARE, 0.0, 1.0 - DARK_SHARE)
    weight[distance > PLATE_EDGE * radius + 2] = 0.0
    off = np.array([(weight * du).sum(), (weight * dv).sum()]) / weight.sum()
    centre: Array = np.array([round(u), round(v)]) + off
    return centre
