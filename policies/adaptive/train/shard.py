"""Shards of training data: some hundred simulated folds, with the critic's inputs in
each.
"""

from pathlib import Path as FilePath
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeInt, PositiveFloat
from threadpoolctl import threadpool_limits

from drivers.base.files import replacing
from drivers.base.settings import Settings
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.strip.rod.lumping import needs_terms
from policies.adaptive.adaptive import LENGTH_RANGE, Adaptive
from policies.adaptive.critic import YIELD_UNIT, Critic, CriticPrediction, array_shapes
from policies.adaptive.features import COUNT, RISE_AT
from policies.rollout import Folds, Rollout, roll_out
from policies.sensing import IMAGE_SENSING, TRAINING
from policies.strip_sampling import STRIP_LENGTH, random_strip

ABSURD = 0.2  # m, to which displacements are clipped
RATES = (45.0, 75.0)  # Hz, range of the camera's rates in training
TRIAL_RATE = 60.0  # Hz
INPUT_STRIDE = 4  # decisions between inputs that are kept
LATEST = 5.8  # s after the first decision, until which rises are switched
NEVER = 1_000_000  # decisions, more than any fold has
UNSWITCHED = 0.25  # share of the folds with random rises whose rise is never switched


Flags = NDArray[np.bool_]


class NullCritic(Critic):
    """Critic whose weights are all zero, for folds before any training."""

    def __init__(self) -> None:
        shapes = array_shapes(COUNT, memory=1, first=1, second=1)
        super().__init__({name: np.zeros(shape) for name, shape in shapes.items()})


class Explorer(Adaptive):
    """Policy that explores: each fold's rise is switched once, at random, and then
    stays.

    Until then rises are the critic's, or random without a critic. `kept` are inputs (n,
    COUNT) at every INPUT_STRIDE-th decision, `rises` (n,) the rises from then on,
    `times` (n,) [s]; `switch` (n,) counts such decisions before the switch.
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
        """Explore: switch rises once by `perturbation` [m] if `switches`; decide at
        `rate` [Hz].
        """
        super().__init__(critic or NullCritic())
        self._random_rises = critic is None
        self._switches = switches
        self._perturbation = perturbation
        self._rng = rng
        self._latest = int(LATEST * rate) // INPUT_STRIDE

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Clear all state; draw for each of `count` folds the decision that changes its
        line.

        That is the line z = x + rise on which the gripper descends, its rise in m.
        """
        super().reset(strip, speed, count)
        rng = self._rng
        highest = self._steering.highest
        self.kept: list[Array] = []
        self.rises: list[Array] = []
        self.times: list[Array] = []
        self._count = 0
        self.switch = rng.integers(0, self._latest, count)
        if not self._switches:
            self.switch = np.full(count, NEVER)

        # NaN until it is drawn at the switch
        self._rise_after: Array = np.full(count, np.nan)
        if self._random_rises:
            self.rise = rng.uniform(0.0, highest, count)
            stays = rng.uniform(size=count) < UNSWITCHED
            self.switch = np.where(stays, 0, self.switch)
            self._rise_after = np.where(
                stays, self.rise, rng.uniform(0.0, highest, count)
            )

    def _predict(self, inputs: Array, fresh: Flags) -> CriticPrediction:
        if self._count % INPUT_STRIDE == 0:
            self.kept.append(inputs.astype(np.float32))
        return super()._predict(inputs, fresh)

    def _smooth_rise(self, prediction: CriticPrediction, time: Array) -> Array:
        """Rises (n,) [m] of the lines z = x + rise along which the grippers of n folds
        descend.

        Before a fold's switch it is the critic's or a random one; then it is perturbed
        once and held. Those of every INPUT_STRIDE-th call are recorded.
        """
        before = (
            self.rise if self._random_rises else super()._smooth_rise(prediction, time)
        )
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

        self._count += 1  # decisions: each predicts once and then smooths the rise once
        return rise


class CriticSettings(Settings):
    """Settings of a critic's training: rounds of simulated folds, followed by a
    regression each.

    In the first round rises are drawn at random; in later ones the critic steers, until
    at a random moment the rise is moved by `perturbation` [m] (one sigma) and kept.
    Every second shard folds strips of 0.6 m, the others one length within
    `adaptive.LENGTH_RANGE`. A last round of `trials` shards folds without perturbation
    and as images are, to set the sigmas.
    """

    seed: NonNegativeInt = 0
    pieces: tuple[int, ...] = (24, 32, 48)  # of folds, in each round
    trials: int = Field(4, ge=1)
    folds: int = Field(256, ge=8)  # in a shard
    perturbation: tuple[float, ...] = (0.0, 0.008, 0.005)
    epochs: tuple[int, ...] = (24, 20, 45)
    speed: PositiveFloat = 0.1
    segments: int = Field(100, ge=20)
    memory: NonNegativeInt = 32
    hidden: tuple[int, int] = (128, 96)

    @property
    def rounds(self) -> int:
        """Number of rounds of the training, each of folds and a regression."""
        return len(self.pieces)


class Shard(NamedTuple):
    """Training data of n folds at k decisions.

    `inputs` (n, k, COUNT) of the critic; `moved` (n, k) [m], the rise from then on
    minus the one in the inputs; `alive` (n, k), before the touch; `predicted` (n, k),
    at or after the switch; `displacement` (n,) [m]; `strip` (n, 3), the true values
    that the critic estimates.
    """

    inputs: Array
    moved: Array
    alive: Flags
    predicted: Flags
    displacement: Array
    strip: Array

    def save(self, path: FilePath) -> None:
        """Write the shard to `path` atomically."""
        with replacing(path) as scratch, scratch.open("wb") as stream:
            np.savez(stream, **self._asdict())

    @classmethod
    def load(cls, path: FilePath) -> Self:
        """Read the shard at `path`; OSError or ValueError where it is missing or
        incomplete.
        """
        with np.load(path, allow_pickle=False) as held:
            return cls(**{name: held[name] for name in cls._fields})


def simulate(
    settings: CriticSettings, turn: int, number: int, critic: Critic | None
) -> Shard:
    """Simulate shard `number` of training round `turn` with `critic`; equal arguments
    give equal shards.

    Strips that need the rod's optional terms fold in a separate batch. Linear algebra
    runs in one thread, as its rounding depends on the number of threads.
    """
    rng = np.random.default_rng([settings.seed, turn, number])
    length = STRIP_LENGTH if number % 2 == 0 else float(rng.uniform(*LENGTH_RANGE))
    with threadpool_limits(1, user_api="blas"):
        strips = [random_strip(rng, length) for _ in range(settings.folds)]
        batches: dict[bool, list[StripFile]] = {False: [], True: []}
        for strip in strips:
            batches[needs_terms(describe(strip))].append(strip)
        filled = filter(None, batches.values())
        return concatenate(
            [
                _fold_strips(settings, strips=batch, turn=turn, critic=critic, rng=rng)
                for batch in filled
            ]
        )


def concatenate(shards: list[Shard]) -> Shard:
    """Shard with the folds of all `shards`, padded to the largest number of
    decisions.
    """
    longest = max(shard.moved.shape[1] for shard in shards)
    padded = [_pad(shard, longest) for shard in shards]
    return Shard(*(np.concatenate(field) for field in zip(*padded, strict=True)))


def _pad(shard: Shard, length: int) -> Shard:
    """Copy of `shard` padded to `length` decisions; the added ones are marked as not
    alive.
    """
    missing = length - shard.moved.shape[1]
    parts = shard._asdict()
    for name in ("inputs", "moved", "alive", "predicted"):
        values = parts[name]
        parts[name] = np.pad(
            values, [(0, 0), (0, missing), *[(0, 0)] * (values.ndim - 2)]
        )
    return Shard(**parts)


def _fold_strips(
    settings: CriticSettings,
    strips: list[StripFile],
    turn: int,
    critic: Critic | None,
    rng: np.random.Generator,
) -> Shard:
    """Training data of `strips`, folded by an exploring policy in round `turn`."""
    trial = turn >= settings.rounds
    rate = TRIAL_RATE if trial else float(rng.uniform(*RATES))
    sensing = IMAGE_SENSING if trial else TRAINING
    rollout = Rollout(speed=settings.speed, rate=rate, sensing=sensing)
    perturbation = 0.0 if trial else settings.perturbation[turn]
    explorer = Explorer(critic, perturbation, rate, rng, switches=not trial)
    rod = Rod(settings.segments, strict=False)
    models = [describe(strip) for strip in strips]
    folds = roll_out(explorer, rod, strips[0], models, settings=rollout, rng=rng)
    return _shard_of(explorer, folds, strips, trial=trial)


def _shard_of(
    explorer: Explorer, folds: Folds, strips: list[StripFile], *, trial: bool
) -> Shard:
    """Training data from `folds` and the inputs that `explorer` kept; in a `trial` all
    decisions count as predictions.
    """
    times = np.array(explorer.times).T
    rises = np.array(explorer.rises).T
    inputs = np.moveaxis(np.array(explorer.kept), 0, 1)
    rises_seen = inputs[..., RISE_AT] * strips[0].length
    touch_times = np.array(
        [np.inf if touch is None else touch.time for touch in folds.touch]
    )
    steps = np.arange(times.shape[1])
    return Shard(
        inputs=inputs,
        moved=(rises - rises_seen).astype(np.float32),
        alive=times < touch_times[:, None],
        predicted=(steps >= explorer.switch[:, None]) | trial,
        displacement=np.clip(folds.displacement, -ABSURD, ABSURD),
        strip=np.array([true_belief(strip) for strip in strips]),
    )


def true_belief(strip: StripFile) -> tuple[float, float, float]:
    """True ln bending length [m], ln retardation time [s] and friction of `strip`.

    These are what the critic estimates; friction is ln(1 + yield curvature /
    YIELD_UNIT).
    """
    curvature = strip.effects.get("bending_hysteresis", {}).get("yield_curvature", 0.0)
    logs = np.log(
        [strip.bending_length, strip.retardation_time, 1.0 + curvature / YIELD_UNIT]
    )
    return float(logs[0]), float(logs[1]), float(logs[2])
