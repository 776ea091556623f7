"""Points of material gathered into pixels: exact coverage, to fractions of a pixel."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array, Image

FULL = 0.96  # coverage from which a pixel counts as filled: what sampling may leave open


@dataclass(frozen=True, slots=True)
class Cloud:
    """Points of material: `pixels` (n, 2), `area` (n,) [px^2] and brightness `shade` (n,)."""

    pixels: Array
    area: Array
    shade: Array

    def seen_from(self, origin: tuple[int, int]) -> Self:
        """The same points with pixels counted from `origin` (u, v)."""
        return replace(self, pixels=self.pixels - np.array(origin))


def paint(image: Image, cloud: Cloud, colour: Array, light: NDArray[np.float32]) -> None:
    """Lay `cloud` over `image` in `colour` (3,) BGR under `light` (height, width), in place.

    Each point spreads its area bilinearly over the four nearest pixels, which keeps its first
    moment; what a pixel gathers is its coverage.
    """
    height, width = image.shape[:2]
    u, v = cloud.pixels[:, 0], cloud.pixels[:, 1]
    inside = (u >= 0) & (u < width - 1) & (v >= 0) & (v < height - 1)
    if not inside.any():
        return
    if not inside.all():
        cloud = Cloud(cloud.pixels[inside], cloud.area[inside], cloud.shade[inside])
    top = int(cloud.pixels[:, 1].min())
    bottom = int(cloud.pixels[:, 1].max()) + 2
    index, weight = _corners(cloud, top, width)
    size = (bottom - top) * width
    coverage = np.bincount(index, weight, size)
    glow = np.bincount(index, weight * np.tile(cloud.shade, 4), size)
    touched = np.flatnonzero(coverage)
    gathered = coverage[touched]
    alpha = np.minimum(gathered / FULL, 1.0)
    ink = (glow[touched] / gathered * alpha * light[top:bottom].reshape(-1)[touched])[
        :, None
    ] * colour
    flat = image[top:bottom].reshape(-1, 3)
    flat[touched] = np.minimum(flat[touched] * (1 - alpha)[:, None] + ink + 0.5, 255)


def _corners(cloud: Cloud, top: int, width: int) -> tuple[Array, Array]:
    whole = cloud.pixels.astype(np.int64)
    part = cloud.pixels - whole
    a, b = part[:, 0], part[:, 1]
    first = (whole[:, 1] - top) * width + whole[:, 0]
    index = np.concatenate([first, first + 1, first + width, first + width + 1])
    right = cloud.area * a
    left = cloud.area - right
    weight = np.concatenate([left - left * b, right - right * b, left * b, right * b])
    return index, weight
