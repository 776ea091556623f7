"""Inputs of the critic: gripper, its line, and line fits to the images of the last 0.12 s."""

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array
from policies.adaptive.window import Window
from policies.policy import Observation
from policies.profile import POINTS

CONTACT_CHANNEL, TIP_CHANNEL, PROFILE_CHANNELS = 0, 1, slice(2, None)  # desk contact x, tip x
CHANNELS = 2 + 2 * POINTS
STATE_SIZE = 9  # inputs before the channels' values and rates: see `Features.inputs`
RISE_AT = 2  # place of the rise among them
RATE = 0.1  # s, by which rates become comparable with values
NOISE_SCALE = 100.0  # by which noise over the length becomes comparable with values
LARGEST_AGE = 0.5  # s, at which the age of the newest image is clipped
REFERENCE_LENGTH = 0.6  # m, length of most strips
COUNT = STATE_SIZE + 2 * CHANNELS
CONFIDENT = 0.5  # confidence of a profile from which it is used


class Features:
    """Turns observations of n strips into inputs (n, COUNT), lengths over the strip's length."""

    def __init__(self, length: float, count: int) -> None:
        self._length = length
        self._window = Window(count, CHANNELS)

    @property
    def newest(self) -> Array:
        """Stamps (n,) [s] of the newest images of sufficient confidence, -inf before the first."""
        return self._window.newest

    def tell(self, seen: Observation) -> NDArray[np.bool_]:
        """Add an observation; returns for which strips (n,) its image is new and reliable."""
        count = len(seen.x)
        flat = seen.profile.reshape(count, -1)
        values = np.concatenate([seen.contact_x[:, None], seen.tip_x[:, None], flat], axis=1)
        good = np.isfinite(values).all(axis=1) & (seen.profile_confidence >= CONFIDENT)
        return self._window.tell(seen.stamp, values / self._length, good)

    def inputs(self, seen: Observation, rise: Array, descending: NDArray[np.bool_]) -> Array:
        """Inputs (n, COUNT) of the critic, from `seen`, `rise` (n,) [m] and `descending` (n,)."""
        trend = self._window.trend()
        x, z, r = seen.x / self._length, seen.z / self._length, rise / self._length
        age = np.clip(seen.time - self.newest, 0.0, LARGEST_AGE)
        profile_noise = trend.spread[:, PROFILE_CHANNELS].mean(axis=1)
        noise = np.stack([trend.spread[:, CONTACT_CHANNEL], profile_noise], axis=1)
        length = np.full(len(x), self._length / REFERENCE_LENGTH)
        state = np.stack([x, z, r, z - x - r, descending, age, length], axis=1)
        return np.concatenate([state, NOISE_SCALE * noise, trend.value, RATE * trend.rate], axis=1)
