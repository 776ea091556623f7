"""Background image behind the strip, and correction for changing light."""

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.calibration import Calibration
from cell.perception.kernels import CELL_PX, EVEN_LIGHT, PATCH_PX, Floats, bridge, brightness
from cell.perception.region import Region
from drivers.types import Image

EDGE = 3  # rows of desk that are averaged to either side of the strip
END_MARGIN = 0.012  # m past the strip's free edge that are replaced too
DARKEST = 3.0  # summed grey levels, to which darker patches are raised: their ratio is noise
LIFTED_SHADE, DESK_SHADE = 0.06, 0.15  # shares of brightness by which evened light may be off


@dataclass(frozen=True, slots=True)
class Background:
    """The scene without the strip: `image` (height, width, 3) BGR of the whole picture.

    `shade` (height, width) is the share of brightness by which the light may still differ after
    it was evened out: more on the desk, where the strip throws its own shadow. Light is the median
    over `about` (odd) by `about` patches.
    """

    image: Image
    shade: Floats
    about: int

    def light(self, image: Image, region: Region, visible: Image) -> Floats:
        """Relative brightness (n + 2, m + 2) of the cells of `region` and a border of one cell.

        EVEN_LIGHT where unchanged since preflight. Shadow and flicker are smooth, a strip is thin:
        the median over a neighbourhood is light only. Pixels where `visible` (h, w) is 0, such as
        the hand, are not used.
        """
        rows, columns = region.cells(PATCH_PX)
        patches = (region.left, region.top, rows, columns)
        now, then = brightness(image, *patches), brightness(self.image, *patches)
        middles = slice(PATCH_PX // 2, None, PATCH_PX)
        clear = visible[middles, middles] > 0
        known = np.ones((rows, columns), np.float32)
        known[: clear.shape[0], : clear.shape[1]] = clear
        ratio = np.asarray(now / np.maximum(then, DARKEST), dtype=np.float32)
        ratio = self._fill_holes(ratio, known)
        steps = np.rint(np.clip(EVEN_LIGHT * ratio, 1, 255)).astype(np.uint8)
        smooth = cv2.blur(cv2.medianBlur(steps, self.about).astype(np.float32), (3, 3))
        cells = cv2.resize(smooth, (columns * PATCH_PX // CELL_PX, rows * PATCH_PX // CELL_PX))
        n, m = region.cells(CELL_PX)
        return np.asarray(cv2.copyMakeBorder(cells[:n, :m], 1, 1, 1, 1, cv2.BORDER_REPLICATE))

    def _fill_holes(self, values: Floats, known: Floats) -> Floats:
        """Replace unknown `values` (n, m) by the mean of known neighbours, or by 1 without any."""
        if known.all():
            return values
        size = (3 * self.about, 3 * self.about)
        weight = cv2.blur(known, size)
        mean = cv2.blur(values * known, size) / np.maximum(weight, 1e-6)
        return np.where(known > 0, values, np.where(weight > 1e-4, mean, 1)).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Place:
    """Rectangle [m] in the plane of the near edge in which the resting strip appears.

    From x = 0 to `length`, between the heights `low` and `high`, its blur and shadow included; its
    midline lies `rise` over the desk's.
    """

    length: float
    rise: float
    low: float
    high: float


def learn_background(
    image: Image, calibration: Calibration, place: Place, about: int
) -> Background:
    """Background of `image` (height, width, 3), with the strip at `place` interpolated over."""
    x = np.linspace(0.0, place.length + END_MARGIN, 60)
    ends = calibration.to_image(np.column_stack([x[[0, -1]], [0.0, 0.0]]))[:, 0]
    columns = np.arange(max(int(ends[0]), 0), min(int(ends[1]) + 1, image.shape[1] - 1))
    bottom, top = (
        np.interp(columns, *calibration.to_image(np.column_stack([x, np.full_like(x, z)])).T)
        for z in (place.low, place.high)
    )
    empty = image.copy()
    first = np.maximum(np.floor(top).astype(int), EDGE)
    last = np.minimum(np.ceil(bottom).astype(int), image.shape[0] - EDGE - 1)
    bridge(empty, columns, first, last, EDGE)
    edge = np.interp(np.arange(image.shape[1]), columns, top) - EDGE
    lying = np.arange(image.shape[0])[:, None] >= edge[None]
    shade = np.where(lying, DESK_SHADE, LIFTED_SHADE).astype(np.float32)
    return Background(empty, shade, about)
