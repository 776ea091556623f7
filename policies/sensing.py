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
        self._sigma = np.array([sensing.contact_sigma, sensing.tip_sigma, sensing.tip_sigma])
        self._period = period
        self._groups = groups
        self._rng = rng
        self._size = count // groups
        self._late = np.tile(rng.uniform(*sensing.delay, size=self._size), groups) / period
        bias = np.tile(rng.normal(size=self._size), groups) * sensing.contact_bias
        self._bias = np.column_stack([bias, np.zeros(count), np.zeros(count)])
        depth = int(np.ceil(sensing.delay[1] / period)) + 2
        self._recent: Array = np.full((depth, count, 3), np.nan)

    def remember(self, seen: Observables) -> None:
        """Take note of the strips' true state at the next decision time."""
        newest = np.column_stack([seen.contact_x, seen.tip])[None]
        self._recent = np.concatenate([newest, self._recent[:-1]])

    def look(self, time: float, points: Array) -> Observation:
        """The observation at `time` [s], grippers at `points` (n, 2), exact."""
        back = np.floor(self._late).astype(int)
        share = (self._late - back)[:, None]
        lane = np.arange(len(points))
        state = (1 - share) * self._recent[back, lane] + share * self._recent[back + 1, lane]
        noise = self._rng.normal(size=(self._size, 3)) * self._sigma
        state = state + self._bias + np.tile(noise, (self._groups, 1))
        now = np.full(len(points), time)
        return Observation(
            time=now,
            x=points[:, 0],
            z=points[:, 1],
            stamp=now - self._late * self._period,
            contact_x=state[:, 0],
            tip_x=state[:, 1],
            tip_z=state[:, 2],
        )
