"""The policy `adaptive`: it moves the path until the displacement that it foresees is 0."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.strip.file import StripFile
from drivers.types import Array
from policies.adaptive.critic import Critic, Judgement
from policies.adaptive.features import Features
from policies.adaptive.steering import Steering
from policies.path import Path, triangular
from policies.policy import Decision, Observation

SMOOTH = 0.08  # s in which the path follows a new judgement
BLIND = 0.2  # s without an image that deserves belief, after which nothing is foreseen
UNKNOWING = 0.07  # of the length, the rise of a fold that nothing is known of: that of `shifted`


class Fold(NamedTuple):
    """State of n folds: `rise` (n,) [m] of their lines, `memory` (n, units) summed over the
    images `told` (n,), `time` (n,) [s] of the last decision.
    """

    rise: Array
    memory: Array
    told: Array
    time: Array


class Adaptive:
    """Steers down along z = x + rise, with the rise at which the critic foresees d = 0.

    While no image deserves belief it holds the rise; after `BLIND` it takes that of `shifted`,
    and `blind` tells.
    """

    name = "adaptive"

    def __init__(self, critic: Critic) -> None:
        self.critic = critic
        self.judgement: Judgement | None = None
        self.blind: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._length, self._speed = 1.0, 0.0
        self._begin(1)

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Forget; prepare to fold `count` strips of the length of `strip` at `speed` [m/s]."""
        self._length, self._speed = strip.length, speed
        self._begin(count)

    def lift(self) -> Path:
        """The triangle, of which the first leg is used."""
        return triangular(self._length)

    @property
    def rise(self) -> Array:
        """Rises (n,) [m] of the lines that the grippers come down on."""
        return self._fold.rise

    def decide(self, observation: Observation) -> Decision:
        """Towards the line of each strip, moved by what its images foretell."""
        fresh = self._features.tell(observation)
        inputs = self._features.inputs(observation, self.rise, self._steering.descending)
        judgement = self._judged(inputs, fresh)
        self.blind = observation.time - self._features.newest > BLIND
        self._fold = self._fold._replace(
            rise=self._moved(judgement, observation.time), time=observation.time
        )
        return self._steering.decide(observation.x, observation.z, self.rise)

    def _judged(self, inputs: Array, fresh: NDArray[np.bool_]) -> Judgement:
        """The judgement on `inputs` (n, COUNT), remembered where they are `fresh`."""
        whitened = self.critic.whitened(inputs)
        memory = self._fold.memory + fresh[:, None] * self.critic.recalled(whitened)
        told = self._fold.told + fresh
        self._fold = self._fold._replace(memory=memory, told=told)
        self.judgement = self.critic.judge(whitened, memory / np.maximum(told, 1)[:, None])
        return self.judgement

    def _moved(self, judgement: Judgement, time: Array) -> Array:
        """The rises (n,) at which d = 0, approached smoothly."""
        wanted = self.rise - judgement.displacement / judgement.slope
        wanted = np.where(self.blind, UNKNOWING * self._length, wanted)
        wanted = np.clip(wanted, 0.0, self._steering.highest)
        since = np.clip(np.nan_to_num(time - self._fold.time, nan=math.inf), 0.0, None)
        followed = 1.0 - np.exp(-since / SMOOTH)
        return np.asarray(self.rise + followed * (wanted - self.rise))

    def _begin(self, count: int) -> None:
        self._steering = Steering(self._length, self._speed, count)
        self._features = Features(self._length, count)
        self._fold = Fold(
            rise=np.full(count, UNKNOWING * self._length),
            memory=np.zeros((count, self.critic.memory)),
            told=np.zeros(count),
            time=np.full(count, np.nan),
        )
