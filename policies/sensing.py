"""What a policy sees of simulated strips: late and noisy, as through a camera."""

from dataclasses import dataclass

import numpy as np

from drivers.strip.engine import Observables
from drivers.types import Array
from policies.policy import Observation


@dataclass(frozen=True, slots=True)
class Sensing:
    """How images spoil the state.

    One-sigma noise [m] of `desk_contact` and of the fold's rightmost point, anew in each image;
    one-sigma bias [m] of the contact, as calibration leaves it, and the delay [s] of images,
    uniform over (low, high): both one value a strip.
    """

    contact_sigma: float = 0.001
    tip_sigma: float = 0.001
    contact_bias: float = 0.001
    delay: tuple[float, float] = (0.0, 0.06)


EXACT = Sensing(contact_sigma=0.0, tip_sigma=0.0, contact_bias=0.0, delay=(0.0, 0.0))


class Eye:
    """Remembers what n strips showed at each decision and gives it back late and noisy.

    The strips come in `groups` equal groups which get the same noise and the same delays.
    """

    def __init__(
        self, sensing: Sensing, period: float, *, count: int, groups: int, rng: np.random.Generator
    ) -> None:
        size = count // groups
        self._sigma = np.array([sensing.contact_sigma, sensing.tip_sigma, sensing.tip_sigma])
        self._rng = rng
        late = np.tile(rng.uniform(*sensing.delay, size=size), groups) / period
        self._delay = late * period
        self._bias = np.zeros((groups, size, 3))
        self._bias[..., 0] = rng.normal(size=size) * sensing.contact_bias
        depth = int(np.ceil(sensing.delay[1] / period)) + 2
        self._recent: Array = np.full((depth, count, 3), np.nan)
        self._newest = 0
        self._back = np.floor(late).astype(int)
        self._share = (late - self._back)[:, None]
        self._lane = np.arange(count)

    def remember(self, seen: Observables) -> None:
        """Take note of the strips' true state at the next decision time."""
        self._newest = (self._newest - 1) % len(self._recent)
        newest = self._recent[self._newest]
        newest[:, 0] = seen.contact_x
        newest[:, 1:] = seen.tip

    def look(self, time: float, points: Array) -> Observation:
        """The observation at `time` [s], grippers at `points` (n, 2), exact."""
        near = (self._newest + self._back) % len(self._recent)
        far = (near + 1) % len(self._recent)
        state = (1 - self._share) * self._recent[near, self._lane]
        state += self._share * self._recent[far, self._lane]
        spoiled = state.reshape(self._bias.shape)
        spoiled += self._bias
        spoiled += self._rng.normal(size=self._bias.shape[1:]) * self._sigma
        now = np.full(len(points), time)
        return Observation(
            time=now,
            x=points[:, 0],
            z=points[:, 1],
            stamp=now - self._delay,
            contact_x=state[:, 0],
            tip_x=state[:, 1],
            tip_z=state[:, 2],
        )
