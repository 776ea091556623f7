"""Exploring policy of training folds: changes each rise at a random moment and records inputs."""

import numpy as np

from drivers.strip.file import StripFile
from drivers.types import Array
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.critic import OUTPUTS, Critic, Prediction
from policies.adaptive.features import COUNT
from policies.policy import Decision, Observation

INPUT_STRIDE = 4  # decisions between inputs that are kept
LATEST = 5.8  # s after the first decision, until which rises are switched
NEVER = 1_000_000  # kept decisions, more than any fold has
UNSWITCHED = 0.25  # share of the folds with random rises whose rise is never switched


class NullCritic(Critic):
    """Placeholder critic whose weights are all zero, for folds before any training."""

    def __init__(self) -> None:
        sizes = {"mean": (COUNT,), "whiten": (COUNT, 1), "recall": (1, 1), "recall_bias": (1,)}
        sizes |= {"first": (2, 1), "first_bias": (1,), "second": (1, 1), "second_bias": (1,)}
        sizes |= {"last": (1, OUTPUTS), "last_bias": (OUTPUTS,), "stretch": (4,)}
        super().__init__({name: np.zeros(size) for name, size in sizes.items()})


class Explorer(Adaptive):
    """Policy whose rises follow a critic, or are random without one, until each fold's switch.

    `kept` are inputs (n, COUNT) at every `INPUT_STRIDE`th decision, `rises` (n,) the rises kept
    from then on, `times` (n,) [s]; `switch` (n,) counts the kept decisions before the switch.
    """

    def __init__(
        self,
        critic: Critic | None,
        perturbation: float,
        rate: float,
        rng: np.random.Generator,
        *,
        switches: bool = True,
    ) -> None:
        """Perturb rises once by `perturbation` [m] if `switches`; decide at `rate` [Hz]."""
        super().__init__(critic or NullCritic())
        self._random_rises, self._switches = critic is None, switches
        self._perturbation, self._rng = perturbation, rng
        self._latest = int(LATEST * rate) // INPUT_STRIDE
        self.kept: list[Array] = []
        self.rises: list[Array] = []
        self.times: list[Array] = []

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Clear all state; draw the time and the new rise of each fold's switch."""
        super().reset(strip, speed, count)
        rng, highest = self._rng, self._steering.highest
        self.kept, self.rises, self.times = [], [], []
        self._count = 0
        self.switch = rng.integers(0, self._latest, count)
        if not self._switches:
            self.switch = np.full(count, NEVER)
        self._rise_after: Array = np.full(count, np.nan)  # NaN until it is drawn at the switch
        if self._random_rises:
            self._fold = self._fold._replace(rise=rng.uniform(0.0, highest, count))
            stays = rng.uniform(size=count) < UNSWITCHED
            self.switch = np.where(stays, 0, self.switch)
            self._rise_after = np.where(stays, self.rise, rng.uniform(0.0, highest, count))

    def decide(self, observation: Observation) -> Decision:
        """Headings along each fold's line, whose rise is the critic's before the switch."""
        decision = super().decide(observation)
        self._count += 1
        return decision

    def _predict(self, inputs: Array, fresh: np.typing.NDArray[np.bool_]) -> Prediction:
        if self._count % INPUT_STRIDE == 0:
            self.kept.append(inputs.astype(np.float32))
        return super()._predict(inputs, fresh)

    def _smooth_rise(self, prediction: Prediction, time: Array) -> Array:
        """Rises (n,) [m]: the critic's before each fold's switch, the drawn ones after it."""
        before = self.rise if self._random_rises else super()._smooth_rise(prediction, time)
        switched = self._count / INPUT_STRIDE >= self.switch
        just_switched = np.isnan(self._rise_after) & switched
        if just_switched.any():
            noise = self._rng.normal(size=len(time)) * self._perturbation
            perturbed = np.clip(before + noise, 0.0, self._steering.highest)
            self._rise_after = np.where(just_switched, perturbed, self._rise_after)
        rise = np.where(switched, self._rise_after, before)
        if self._count % INPUT_STRIDE == 0:
            self.rises.append(rise)
            self.times.append(time)
        return np.asarray(rise)
