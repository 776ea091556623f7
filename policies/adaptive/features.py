"""Inputs of the critic: gripper position, line of descent, trends of the last 0.12 s of
images.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.base.types import Array
from policies.policy import Observation
from policies.profile import POINTS

CONTACT_CHANNEL = 0  # x of the desk contact; the next is x of the tip
PROFILE_CHANNELS = slice(2, None)
CHANNELS = 2 + 2 * POINTS
STATE_SIZE = 9  # inputs before the channels' values and rates: see `Features.inputs`
RISE_AT = 2  # place of the rise among them
RATE = 0.1  # s, by which rates become comparable with values
NOISE_SCALE = 100.0  # by which noise over the length becomes comparable with values
LARGEST_AGE = 0.5  # s, at which the age of the newest image is clipped
REFERENCE_LENGTH = 0.6  # m, length of most strips
COUNT = STATE_SIZE + 2 * CHANNELS
CONFIDENT = 0.5  # confidence of a profile from which it is used
WINDOW_TIME = 0.12  # s of images that count
FRAME_COUNT = 12  # frames kept, enough for cameras up to 100 Hz
# s^2, ridge on the slope: variance of the noise over that of the rates that occur
RATE_NOISE = 1.6e-5
# over the length: deviations from the line that begin to count less
OUTLIER_DEVIATION = 1.5e-3
PASSES = 2  # of reweighting


class Trend(NamedTuple):
    """Lines fitted over time to the images of n strips, for each channel.

    `value` and `rate` [1/s] (n, channels) at the newest image, and `spread` (n,
    channels), the rms deviation of the images from the line.
    """

    value: Array
    rate: Array
    spread: Array


class RecentImages:
    """Buffer of the measurements in the newest FRAME_COUNT images of each of n
    strips.
    """

    def __init__(self, count: int, channels: int) -> None:
        """Buffer of images for `count` strips, with `channels` values per image."""
        self._stamps: Array = np.full((count, FRAME_COUNT), -np.inf)
        self._values: Array = np.zeros((count, FRAME_COUNT, channels))

    @property
    def newest(self) -> Array:
        """Stamps (n,) [s] of the strips' newest images, -inf before the first."""
        return self._stamps[:, 0]

    def add(
        self, stamp: Array, values: Array, reliable: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Add `values` (n, channels) where they are `reliable` and their `stamp` [s] is
        later; return the mask (n,) of those added.
        """
        stamps = self._stamps
        new = reliable & (stamp > self.newest)
        if new.any():
            stamps[new, 1:] = stamps[new, :-1]
            self._values[new, 1:] = self._values[new, :-1]
            stamps[new, 0] = stamp[new]
            self._values[new, 0] = values[new]
        return new

    def trend(self) -> Trend:
        """Lines fitted to the images of the last WINDOW_TIME, outliers weighted down
        (Cauchy).
        """
        values = self._values
        with np.errstate(invalid="ignore"):
            since_newest = self._stamps - self.newest[:, None]  # s, negative
        is_recent = np.nan_to_num(since_newest, nan=-np.inf) >= -WINDOW_TIME
        counts = is_recent[..., None]
        t = np.where(counts, since_newest[..., None], 0.0)

        weight = np.broadcast_to(counts, values.shape).astype(np.float64)
        for _ in range(PASSES):
            line = _fit_line(t, values, weight)
            ratio = _residuals(t, values, line) / OUTLIER_DEVIATION
            weight = counts / (1.0 + ratio**2)
        line = _fit_line(t, values, weight)

        squares = np.where(counts, _residuals(t, values, line), 0.0) ** 2
        images = np.maximum(counts.sum(axis=1), 1)
        return Trend(*line, np.sqrt(squares.sum(axis=1) / images))


def _fit_line(t: Array, values: Array, weight: Array) -> tuple[Array, Array]:
    """Values at t = 0 and slopes (n, channels) of weighted lines, with a ridge on the
    slopes.

    Cramer's rule for the normal equations, whose moments are s_k = sum w t^k and
    y_k = sum w t^k y.
    """
    first = weight * t
    s0 = weight.sum(axis=1) + 1e-12
    s1 = first.sum(axis=1)
    s2 = (first * t).sum(axis=1) + RATE_NOISE
    y0 = (weight * values).sum(axis=1)
    y1 = (weight * values * t).sum(axis=1)

    rate = (s0 * y1 - s1 * y0) / (s0 * s2 - s1 * s1)
    return (y0 - s1 * rate) / s0, rate


def _residuals(t: Array, values: Array, line: tuple[Array, Array]) -> Array:
    """Deviations (n, count, channels) of `values` at times `t` from `line`, a value at
    t = 0 and a slope.
    """
    value, rate = line
    return values - value[:, None] - rate[:, None] * t


class Features:
    """Converter of observations to the critic's inputs; lengths are divided by the
    strip's.
    """

    def __init__(self, length: float, count: int) -> None:
        self._length = length
        self._window = RecentImages(count, CHANNELS)

    @property
    def newest(self) -> Array:
        """Stamps (n,) [s] of the newest images of sufficient confidence, -inf before
        the first.
        """
        return self._window.newest

    def add(self, observation: Observation) -> NDArray[np.bool_]:
        """Add an observation; returns the mask (n,) of strips with a new reliable
        image.
        """
        count = len(observation.x)
        flat = observation.profile.reshape(count, -1)
        values = np.column_stack([observation.contact_x, observation.tip_x, flat])
        good = np.isfinite(values).all(axis=1) & (
            observation.profile_confidence >= CONFIDENT
        )
        return self._window.add(observation.stamp, values / self._length, good)

    def inputs(
        self, observation: Observation, rise: Array, descending: NDArray[np.bool_]
    ) -> Array:
        """Inputs (n, COUNT) of the critic from observation, rises (n,) [m], mask of
        descents.
        """
        whole = self._length
        x = observation.x / whole
        z = observation.z / whole
        r = rise / whole
        age = np.clip(observation.time - self.newest, 0.0, LARGEST_AGE)
        length = np.full(len(x), whole / REFERENCE_LENGTH)
        state = np.stack([x, z, r, z - x - r, descending, age, length], axis=1)

        trend = self._window.trend()
        profile_noise = trend.spread[:, PROFILE_CHANNELS].mean(axis=1)
        noise = np.stack([trend.spread[:, CONTACT_CHANNEL], profile_noise], axis=1)
        return np.concatenate(
            [state, NOISE_SCALE * noise, trend.value, RATE * trend.rate], axis=1
        )
