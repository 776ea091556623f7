"""The critic: predicts a fold's displacement with its uncertainty, and estimates the strip."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import numpy as np

from drivers.types import Array
from policies.prediction import Estimate

LARGEST_SLOPE, SMALLEST_SLOPE = 2.0, 0.1  # of dd/dr that are believed
DISPLACEMENT, SLOPE, SPREAD = range(3)
STRIP = 3  # first of the outputs about the strip: (mean, log sigma) each
OUTPUTS = STRIP + 6
INPUT_LIMIT = 8.0  # spreads from the mean beyond which inputs are not believed
UNIT = 0.01  # m, of displacement in the outputs
YIELD_UNIT = 10.0  # 1/m, yarn friction that makes one unit of its output
ARRAY_NAMES = (
    *("mean", "whiten", "recall", "recall_bias", "first", "first_bias"),
    *("second", "second_bias", "last", "last_bias", "stretch"),
)


class Belief(NamedTuple):
    """Estimate of the strip from n folds so far: `log_bending_length`, `log_retardation_time` [m,
    s] and `friction`, ln(1 + yield curvature / YIELD_UNIT), each mean and sigma: arrays (n, 2).
    """

    log_bending_length: Array
    log_retardation_time: Array
    friction: Array

    def first(self) -> dict[str, Estimate]:
        """The first fold's bending length [m], retardation time [s] and yield curvature [1/m]."""
        logs = (self.log_bending_length, self.log_retardation_time, self.friction)
        ends = [
            np.exp(mean + np.array([0.0, -sigma, sigma])) for mean, sigma in (b[0] for b in logs)
        ]
        ends[2] = YIELD_UNIT * np.maximum(ends[2] - 1.0, 0.0)
        names = ("bending_length", "retardation_time", "yield_curvature")
        return {name: Estimate(*map(float, each)) for name, each in zip(names, ends, strict=True)}


class Judgement(NamedTuple):
    """Prediction for n folds: the `displacement` (n,) [m] if the rise is kept, its `slope` (n,)
    over the rise, its `sigma` (n,) [m], and the `belief` about the strips.
    """

    displacement: Array
    slope: Array
    sigma: Array
    belief: Belief


def middle(judgements: Sequence[Judgement]) -> Judgement:
    """Medians of `judgements` on the same folds, at least one: a single outlier moves none."""

    def median(of: Callable[[Judgement], Array]) -> Array:
        return np.asarray(np.median([of(judged) for judged in judgements], axis=0))

    return Judgement(
        displacement=median(lambda judged: judged.displacement),
        slope=median(lambda judged: judged.slope),
        sigma=median(lambda judged: judged.sigma),
        belief=Belief(
            log_bending_length=median(lambda judged: judged.belief.log_bending_length),
            log_retardation_time=median(lambda judged: judged.belief.log_retardation_time),
            friction=median(lambda judged: judged.belief.friction),
        ),
    )


class Critic:
    """A network of two hidden layers over whitened inputs and a running mean of its memory units.

    `recalled` inputs (n, inputs) become (n, memory) units, whose mean over a fold's images is the
    fold's memory; `judge` reads inputs and memory. `weights` are the arrays called ARRAY_NAMES.
    """

    def __init__(self, weights: dict[str, Array]) -> None:
        self.weights = {name: np.asarray(weights[name], dtype=np.float64) for name in ARRAY_NAMES}

    @property
    def memory(self) -> int:
        """Number of memory units."""
        return int(self.weights["recall"].shape[1])

    def whiten(self, inputs: Array) -> Array:
        """Inputs (n, inputs) with unit spread uncorrelated, within `INPUT_LIMIT` of their mean."""
        return np.clip(
            (inputs - self.weights["mean"]) @ self.weights["whiten"], -INPUT_LIMIT, INPUT_LIMIT
        )

    def memorise(self, whitened: Array) -> Array:
        """Contribution (n, memory) of whitened inputs (n, k) to the memory."""
        return np.tanh(whitened @ self.weights["recall"] + self.weights["recall_bias"])

    def judge(self, whitened: Array, memory: Array) -> Judgement:
        """The prediction from whitened inputs (n, k) with `memory` (n, memory)."""
        w = self.weights
        known = np.concatenate([whitened, memory], axis=1)
        hidden = np.tanh(known @ w["first"] + w["first_bias"])
        hidden = np.tanh(hidden @ w["second"] + w["second_bias"])
        out = hidden @ w["last"] + w["last_bias"]
        stretch = w["stretch"]
        spread = np.exp(np.clip(out[:, [SPREAD, 4, 6, 8]], -8.0, 4.0)) * stretch
        strip = np.stack([out[:, STRIP::2], spread[:, 1:]], axis=2)
        return Judgement(
            displacement=UNIT * out[:, DISPLACEMENT],
            slope=np.clip(out[:, SLOPE], SMALLEST_SLOPE, LARGEST_SLOPE),
            sigma=UNIT * spread[:, 0],
            belief=Belief(strip[:, 0], strip[:, 1], strip[:, 2]),
        )

    def with_stretch(self, stretch: Array) -> Self:
        """A copy of the critic with its four sigmas larger by `stretch` (4,)."""
        return type(self)(self.weights | {"stretch": self.weights["stretch"] * stretch})
