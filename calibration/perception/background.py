"""Background image behind the strip, and correction for changing light."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.calibration import Calibration
from calibration.perception.region import Region
from drivers.types import Array, Image

CELL = 8  # px: light changes little over so much
ABOUT = 9  # cells over whose median the light is read: the strip covers less than half
EVEN = 120  # level of light as bright as at preflight
MARGIN = 0.002  # m about the resting strip that its blur and shadow reach
EDGE = 3  # rows of desk that are averaged to either side of it
LIFTED_SHADE, DESK_SHADE = 0.06, 0.15  # shares of brightness by which evened light may be off

Gain = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Background:
    """The scene without the strip: `image` (height, width, 3) BGR of the whole picture.

    `shade` (height, width) is the share of brightness by which the light may still differ after
    it was evened out: more on the desk, where the strip throws its own shadow.
    """

    image: Image
    shade: NDArray[np.float32]

    def light(self, seen: Image, region: Region, visible: Image) -> Image:
        """(h, w) brightness of the image `seen` (h, w, 3) of `region`, EVEN where unchanged since
        preflight.

        Shadow and flicker are smooth, a strip is thin: the median over a neighbourhood is light
        only. Pixels where `visible` (h, w) is 0, such as the hand, are not used.
        """
        h, w = seen.shape[:2]
        size = (-(-w // CELL), -(-h // CELL))
        now, then, clear = (
            cv2.resize(part, size, interpolation=cv2.INTER_LINEAR)
            for part in (seen, region.of(self.image), visible)
        )
        bright = np.maximum(then.sum(axis=2, dtype=np.float32), 3.0)
        ratio = now.sum(axis=2, dtype=np.float32) / bright
        ratio = _filled(ratio, (clear == 255).astype(np.float32))
        steps = np.rint(np.clip(EVEN * ratio, 1, 255)).astype(np.uint8)
        smooth = cv2.blur(cv2.medianBlur(steps, ABOUT), (3, 3))
        return np.asarray(cv2.resize(smooth, (w, h), interpolation=cv2.INTER_LINEAR))


def background(
    image: Image, calibration: Calibration, length: float, height: tuple[float, float]
) -> Background:
    """The scene of `image` (height, width, 3) with the resting strip taken out.

    The strip is `length` [m] long and seen between two heights [m] of the near edge's plane.
    """
    x = np.linspace(0.0, length + 0.012, 60)
    ends = calibration.to_image(np.column_stack([x[[0, -1]], [0.0, 0.0]]))[:, 0]
    columns = np.arange(max(int(ends[0]), 0), min(int(ends[1]) + 1, image.shape[1] - 1))
    bottom, top = (
        np.interp(columns, *calibration.to_image(np.column_stack([x, 0 * x + z])).T)
        for z in (height[0] - MARGIN, height[1] + MARGIN)
    )
    empty = image.copy()
    _bridge(empty, columns, np.floor(top).astype(int), np.ceil(bottom).astype(int))
    edge = np.interp(np.arange(image.shape[1]), columns, top) - EDGE
    lying = np.arange(image.shape[0])[:, None] >= edge[None]
    return Background(empty, np.where(lying, DESK_SHADE, LIFTED_SHADE).astype(np.float32))


def _bridge(image: Image, columns: Array, top: Array, bottom: Array) -> None:
    """Interpolate every column between its rows `top` and `bottom`, in place."""
    height = image.shape[0]
    tops, bottoms = np.maximum(top, EDGE), np.minimum(bottom, height - EDGE - 1)
    for u, first, last in zip(columns, tops, bottoms, strict=True):
        if first >= last:
            continue
        above = image[first - EDGE : first, u].mean(axis=0)
        below = image[last + 1 : last + 1 + EDGE, u].mean(axis=0)
        share = (np.arange(first, last + 1) - first + 1)[:, None] / (last - first + 2)
        image[first : last + 1, u] = np.rint(above + share * (below - above))


def _filled(values: Gain, known: Gain) -> Gain:
    """Values (n, m) where `known`, the mean of neighbouring known ones elsewhere."""
    if known.all():
        return values
    size = (3 * ABOUT, 3 * ABOUT)
    weight = cv2.blur(known, size)
    mean = cv2.blur(values * known, size) / np.maximum(weight, 1e-6)
    overall = float(np.median(values[known > 0])) if known.any() else 1.0
    return np.where(known > 0, values, np.where(weight > 1e-4, mean, overall)).astype(np.float32)
