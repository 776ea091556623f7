"""The strip's soft shadow on the desk."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.twin.renderer.curve import Curve
from drivers.twin.renderer.kernels import greatest
from drivers.twin.renderer.look import StripLook
from drivers.twin.renderer.optics import Optics
from drivers.twin.settings import CameraSettings
from drivers.types import Array, Image

TABLE_RANGE = (-0.2, 1.2)  # m of x that the table covers, as shares of nothing but generosity
BINS = 1400
IMAGE_MARGIN = 50  # px beside the image, up to which desk counts for the rows of the shadow
FADE_HEIGHT = 0.03  # m of height over which the shadow fades
SOFT_BORDER = 0.004  # m, half of its soft border in y


@dataclass(frozen=True, slots=True)
class ShadowBand:
    """Image rows, from `top` on, in which the desk under the strip appears.

    `bins` (rows, width) place along x, `weight` (rows, width) how much of the shadow they take.
    """

    top: int
    bins: NDArray[np.int32]
    weight: NDArray[np.float32]

    def cast(self, image: Image, origin: tuple[int, int], profile: Array) -> None:
        """Darken the desk in `image`, whose first pixel is (u, v) = `origin`, in place."""
        u, v = origin
        first, last = max(self.top, v), min(self.top + len(self.bins), v + image.shape[0])
        if first >= last:
            return
        rows = slice(first - self.top, last - self.top)
        columns = slice(u, u + image.shape[1])
        dark = 1 - self.weight[rows, columns] * profile.astype(np.float32)[self.bins[rows, columns]]
        part = image[first - v : last - v]
        part[:] = part * dark[..., None]


def shadow_band(settings: CameraSettings, optics: Optics, look: StripLook) -> ShadowBand:
    """Shadow band of the image rows in which the camera sees the desk at the strip's depths."""
    floor = -look.thickness / 2
    top, bottom = _band_rows(settings, optics, look.width, floor)
    u, v = np.meshgrid(
        np.arange(settings.width, dtype=np.float32), np.arange(top, bottom, dtype=np.float32)
    )
    at_x, at_y = optics.on_level(optics.rays(u, v), floor)
    bins = np.clip(
        (at_x - TABLE_RANGE[0]) / (TABLE_RANGE[1] - TABLE_RANGE[0]) * BINS, 0, BINS - 1
    ).astype(np.int32)
    inside = np.minimum(at_y, look.width - at_y) / SOFT_BORDER
    weight = np.clip(0.5 + 0.5 * inside, 0, 1) * settings.shadow
    return ShadowBand(top, bins, weight.astype(np.float32))


def _band_rows(
    settings: CameraSettings, optics: Optics, width: float, floor: float
) -> tuple[int, int]:
    """First and last row (exclusive) of the shadow of a strip of `width` [m] on the `floor` [m]."""
    x = np.linspace(*TABLE_RANGE, 15)
    depths = (-2 * SOFT_BORDER, width + 2 * SOFT_BORDER)
    seen = np.concatenate([optics.plane(np.stack([x, 0 * x + floor], -1), y) for y in depths])
    seen = seen[(seen[:, 0] > -IMAGE_MARGIN) & (seen[:, 0] < settings.width + IMAGE_MARGIN)]
    top = int(np.clip(seen[:, 1].min() - 1, 0, settings.height - 1))
    return top, int(np.clip(seen[:, 1].max() + 2, top + 1, settings.height))


def shadow_profile(curve: Curve) -> Array:
    """Depth (BINS,) of the shadow along x, 0 to 1: the deeper, the lower the strip hangs."""
    place = (curve.points[:, 0] - TABLE_RANGE[0]) / (TABLE_RANGE[1] - TABLE_RANGE[0]) * BINS
    bins = np.clip(place, 0, BINS - 1).astype(np.int64)
    depth = np.exp(-np.maximum(curve.points[:, 1], 0) / FADE_HEIGHT)
    soft: Array = cv2.blur(greatest(bins, depth, BINS)[None, :], (7, 1))[0]
    return soft
