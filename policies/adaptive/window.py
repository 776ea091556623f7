"""Line fits to the measurements in n strips' images of the last 0.12 s: values and their rates."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array

WINDOW_TIME = 0.12  # s of images that count
FRAME_COUNT = 12  # frames kept, enough for cameras up to 100 Hz
# s^2, ridge on the slope: variance of the noise over that of the rates that occur
RATE_NOISE = 1.6e-5
OUTLIER_DEVIATION = 1.5e-3  # over the length: deviations from the line that begin to count less
PASSES = 2  # of reweighting


class Trend(NamedTuple):
    """Trend of n strips and their channels: `value` and `rate` (n, channels) at the newest image,
    and `spread` (n, channels), the rms deviation of the images from the line.
    """

    value: Array
    rate: Array
    spread: Array


class Window:
    """Measurements in n strips' newest images; an image not newer than the last is ignored."""

    def __init__(self, count: int, channels: int) -> None:
        """Keep measurements of `count` strips, `channels` values an image."""
        self._stamps: Array = np.full((count, FRAME_COUNT), -np.inf)
        self._values: Array = np.zeros((count, FRAME_COUNT, channels))

    @property
    def newest(self) -> Array:
        """Stamps (n,) [s] of the newest images, -inf before the first."""
        return self._stamps[:, 0]

    def tell(self, stamp: Array, values: Array, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Add `values` (n, channels) of `stamp` (n,) [s] where `good`; returns which are new."""
        new = good & (stamp > self.newest)
        if new.any():
            self._stamps[new, 1:] = self._stamps[new, :-1]
            self._values[new, 1:] = self._values[new, :-1]
            self._stamps[new, 0], self._values[new, 0] = stamp[new], values[new]
        return new

    def trend(self) -> Trend:
        """Lines fitted to the images of the last `WINDOW_TIME`, outliers weighted down (Cauchy)."""
        with np.errstate(invalid="ignore"):
            ago = self._stamps - self.newest[:, None]
        inside = np.nan_to_num(ago, nan=-np.inf) >= -WINDOW_TIME
        t = np.where(inside, ago, 0.0)[..., None]
        inside = inside[..., None]
        weight = np.broadcast_to(inside, self._values.shape).astype(np.float64)
        for _ in range(PASSES):
            value, rate = _fit_line(t, self._values, weight)
            off = self._values - value[:, None] - rate[:, None] * t
            weight = inside / (1.0 + (off / OUTLIER_DEVIATION) ** 2)
        value, rate = _fit_line(t, self._values, weight)
        off = np.where(inside, self._values - value[:, None] - rate[:, None] * t, 0.0)
        spread = np.sqrt((off**2).sum(axis=1) / np.maximum(inside.sum(axis=1), 1))
        return Trend(value, rate, spread)


def _fit_line(t: Array, values: Array, weight: Array) -> tuple[Array, Array]:
    """Value at t = 0 and slope of weighted least-squares lines, with a ridge on the slope."""
    s0 = weight.sum(axis=1) + 1e-12
    s1, s2 = (weight * t).sum(axis=1), (weight * t * t).sum(axis=1) + RATE_NOISE
    y0, y1 = (weight * values).sum(axis=1), (weight * values * t).sum(axis=1)
    rate = (s0 * y1 - s1 * y0) / (s0 * s2 - s1 * s1)
    return (y0 - s1 * rate) / s0, rate
