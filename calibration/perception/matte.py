"""Alpha matte of the strip: the fraction of each pixel that is strip, for
uniform strip and scene.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from drivers.types import Array, Image, frozen

ZERO, SCALE = 48.0, 160.0  # grey levels of a matte: all background, and from there to all strip
NOISE = 2.5  # grey levels of a camera
SHADE = 0.15  # share of brightness by which light, folds and shadow change a colour


@dataclass(frozen=True, slots=True)
class Matte:
    """A linear estimate of each pixel's fraction of strip: `row` (1, 4) for a BGR image.

    `separation` is the distance of strip and surroundings in standard deviations of a pixel.
    """

    row: Array
    separation: float

    @property
    def noise(self) -> float:
        """Standard deviation of a pixel's share of strip, from the camera's noise alone."""
        return float(np.hypot.reduce(self.row[0, :3])) * NOISE / SCALE

    def of(self, image: Image) -> Image:
        """(h, w) grey levels: ZERO is background, ZERO + SCALE is strip."""
        return np.asarray(cv2.transform(image, self.row), dtype=np.uint8)


def matte(strip: Array, desk: Array, backdrop: Array) -> Matte:
    """Fisher's discriminant of the strip's colour from both others, (3,) BGR each.

    Noise, brightness of either and the difference of desk and backdrop count as scatter, so that
    shadow and light gradient affect the matte as little as the colours allow.
    """
    around = (desk + backdrop) / 2
    spread = NOISE**2 * np.eye(3)
    for change in (SHADE * strip, SHADE * desk, SHADE * backdrop, (desk - backdrop) / 2):
        spread += np.outer(change, change)
    away = strip - around
    weights = np.linalg.solve(spread, away)
    reach = float(away @ weights)
    if reach <= 0:
        return Matte(frozen(np.zeros((1, 4))), 0.0)
    weights *= SCALE / reach
    row = np.array([[*weights, ZERO - weights @ around]])
    return Matte(frozen(row), float(np.sqrt(reach)))


def soft(levels: Image) -> Image:
    """Matte levels (h, w), smoothed to half the noise without moving borders."""
    return np.asarray(cv2.GaussianBlur(levels, (3, 3), 0), dtype=np.uint8)


def share(levels: Array | Image) -> Array:
    """Fractions of strip (...,) from matte grey levels (...,): 0 to 1 and slightly beyond."""
    return np.asarray((np.asarray(levels, dtype=np.float64) - ZERO) / SCALE)
