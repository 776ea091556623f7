"""The critic, a network that predicts a fold's displacement and estimates the strip's behaviour."""

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
    """Estimates of n strips, arrays (n, 2) of mean and standard deviation: `log_bending_length`
    [ln m], `log_retardation_time` [ln s] and `friction`, ln(1 + yield curvature / YIELD_UNIT).
    """

    log_bending_length: Array
    log_retardation_time: Array
    friction: Array

    def first(self) -> dict[str, Estimate]:
        """Bending length [m], retardation time [s], yield curvature [1/m] of the first strip."""
        logs = (self.log_bending_length, self.log_retardation_time, self.friction)
        ends = [
            np.exp(mean + np.array([0.0, -sigma, sigma])) for mean, sigma in (b[0] for b in logs)
        ]
        ends[2] = YIELD_UNIT * np.maximum(ends[2] - 1.0, 0.0)
        names = ("bending_length", "retardation_time", "yield_curvature")
        return {name: Estimate(*map(float, each)) for name, each in zip(names, ends, strict=True)}


class Judgement(NamedTuple):
    """Prediction for n folds: `displacement` (n,) [m] if the rise is kept, its derivative `slope`
    (n,) by the rise, its standard deviation `sigma` (n,) [m], and the `belief` about the strips.
    """

    displacement: Array
    slope: Array
    sigma: Array
    belief: Belief


def middle(judgements: Sequence[Judgement]) -> Judgement:
    """Median, element by element, of at least one prediction of the same folds."""

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
    """A network of two hidden layers over whitened inputs and the mean of its memory units.

    The layer `recall` turns inputs (n, k) into (n, memory) units, whose mean over a fold's images
    is the fold's memory; `judge` reads both. `weights` are the arrays called ARRAY_NAMES.
    """

    def __init__(self, weights: dict[str, Array]) -> None:
        self.weights = {name: np.asarray(weights[name], dtype=np.float64) for name in ARRAY_NAMES}

    @property
    def memory(self) -> int:
        """Number of memory units."""
        return int(self.weights["recall"].shape[1])

    def whiten(self, inputs: Array) -> Array:
        """Inputs (n, k) decorrelated and scaled to unit variance, clipped to +-`INPUT_LIMIT`."""
        return np.clip(
            (inputs - self.weights["mean"]) @ self.weights["whiten"], -INPUT_LIMIT, INPUT_LIMIT
        )

    def memorise(self, whitened: Array) -> Array:
        """Values (n, memory) of the memory units for `whitened` inputs (n, k) of one image."""
        return np.tanh(whitened @ self.weights["recall"] + self.weights["recall_bias"])

    def judge(self, whitened: Array, memory: Array) -> Judgement:
        """Prediction from `whitened` inputs (n, k) and the mean memory units (n, memory)."""
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
        """A copy of the critic with its four standard deviations multiplied by `stretch` (4,)."""
        return type(self)(self.weights | {"stretch": self.weights["stretch"] * stretch})
