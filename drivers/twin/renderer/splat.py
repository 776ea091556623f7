"""Splatting of material points into pixels with exact fractional coverage."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array, Image

Indices = NDArray[np.int64]
FULL = 0.96  # coverage from which a pixel counts as filled: what sampling may leave open


@dataclass(frozen=True, slots=True)
class Cloud:
    """Points of material at `u`, `v` [px]: `area` [px^2] and brightness `shade`, all (n,).

    `tint` (n, 3) BGR are colours of their own; None where all share that of the strip.
    """

    u: Array
    v: Array
    area: Array
    shade: Array
    tint: Array | None = None

    def seen_from(self, origin: tuple[int, int]) -> Self:
        """The same points with pixels counted from `origin` (u, v)."""
        return replace(self, u=self.u - origin[0], v=self.v - origin[1])

    def within(self, width: int, height: int) -> Self:
        """The points whose four nearest pixels all lie in an image of this size."""
        u, v = self.u, self.v
        inside = (u >= 0) & (u < width - 1) & (v >= 0) & (v < height - 1)
        if inside.all():
            return self
        return replace(
            self,
            u=u[inside],
            v=v[inside],
            area=self.area[inside],
            shade=self.shade[inside],
            tint=None if self.tint is None else self.tint[inside],
        )


def paint(image: Image, cloud: Cloud, colour: Array, light: NDArray[np.float32]) -> None:
    """Lay `cloud` over `image` in `colour` (3,) BGR under `light` (height, width), in place.

    Each point spreads its area bilinearly over the four nearest pixels, which keeps its first
    moment; what a pixel gathers is its coverage.
    """
    height, width = image.shape[:2]
    cloud = cloud.within(width, height)
    if len(cloud.u) == 0:
        return
    top, bottom = int(cloud.v.min()), int(cloud.v.max()) + 2
    index, weight = _corners(cloud, top, width)
    touched, index = _compact(index, (bottom - top) * width)
    coverage = np.bincount(index, weight)
    glow = np.bincount(index, weight * np.tile(cloud.shade, 4))
    alpha = np.minimum(coverage / FULL, 1.0)
    lit = glow / np.maximum(coverage, 1e-12) * light[top:bottom].reshape(-1)[touched]
    ink = (lit * alpha)[:, None] * _mix(cloud, colour, index, weight)
    flat = image[top:bottom].reshape(-1, 3)
    flat[touched] = np.minimum(flat[touched] * (1 - alpha)[:, None] + ink + 0.5, 255)


def _mix(cloud: Cloud, colour: Array, index: Indices, weight: Array) -> Array:
    """The one `colour` (3,), or the mean colour (m, 3) at each pixel, by brightness."""
    if cloud.tint is None:
        return colour
    glow = weight * np.tile(cloud.shade, 4)
    gathered = [np.bincount(index, glow * np.tile(tint, 4)) for tint in cloud.tint.T]
    return np.stack(gathered, axis=-1) / np.maximum(np.bincount(index, glow), 1e-12)[:, None]


def _compact(index: Indices, size: int) -> tuple[Indices, Indices]:
    """The distinct values below `size` in `index`, and `index` as positions among them."""
    occurs = np.zeros(size, dtype=np.bool_)
    occurs[index] = True
    values = np.flatnonzero(occurs)
    place = np.empty(size, dtype=np.int64)
    place[values] = np.arange(len(values))
    return values, place[index]


def _corners(cloud: Cloud, top: int, width: int) -> tuple[Indices, Array]:
    left_of, above = cloud.u.astype(np.int64), cloud.v.astype(np.int64)
    a, b = cloud.u - left_of, cloud.v - above
    first = (above - top) * width + left_of
    index = np.concatenate([first, first + 1, first + width, first + width + 1])
    right = cloud.area * a
    left = cloud.area - right
    weight = np.concatenate([left - left * b, right - right * b, left * b, right * b])
    return index, weight
