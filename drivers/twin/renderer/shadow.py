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
FADE_HEIGHT = 0.03  # m of height over which the shadow fades
SOFT_BORDER = 0.004  # m, half of its soft border in y


@dataclass(frozen=True, slots=True)
class ShadowBand:
    """Rows of the image from `top` on that see desk under the strip.

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
    """Where the camera sees the desk at the depths that the strip covers."""
    floor = -look.thickness / 2
    depths = (-2 * SOFT_BORDER, look.width + 2 * SOFT_BORDER)
    x = np.linspace(*TABLE_RANGE, 15)
    seen = np.concatenate([optics.plane(np.stack([x, 0 * x + floor], -1), y) for y in depths])
    seen = seen[(seen[:, 0] > -50) & (seen[:, 0] < settings.width + 50)]
    top = int(np.clip(seen[:, 1].min() - 1, 0, settings.height - 1))
    bottom = int(np.clip(seen[:, 1].max() + 2, top + 1, settings.height))
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


def shadow_profile(curve: Curve) -> Array:
    """(BINS,) depth of the shadow along x, 0 to 1: the deeper, the lower the strip hangs."""
    place = (curve.points[:, 0] - TABLE_RANGE[0]) / (TABLE_RANGE[1] - TABLE_RANGE[0]) * BINS
    bins = np.clip(place, 0, BINS - 1).astype(np.int64)
    depth = np.exp(-np.maximum(curve.points[:, 1], 0) / FADE_HEIGHT)
    soft: Array = cv2.blur(greatest(bins, depth, BINS)[None, :], (7, 1))[0]
    return soft
