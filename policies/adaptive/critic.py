"""The critic, a network that predicts a fold's displacement and estimates the strip's
stiffness, and the correction of its bias, learned from folds through images.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.base.settings import Settings, StudyResult
from drivers.base.types import Array
from policies.policy import ParameterEstimate

LARGEST_SLOPE, SMALLEST_SLOPE = 2.0, 0.1  # to which predicted dd/dr are clipped
DISPLACEMENT, SLOPE, SPREAD = range(3)
STRIP = 3  # first of the outputs about the strip: (mean, log sigma) each
OUTPUTS = STRIP + 6
STRIP_MEANS, STRIP_LOG_SIGMAS = slice(STRIP, OUTPUTS, 2), slice(STRIP + 1, OUTPUTS, 2)
# outputs, of displacement and strip
LOG_SIGMAS = [SPREAD, *range(OUTPUTS)[STRIP_LOG_SIGMAS]]
# to which they are clipped, against overflow of the exponential
LOG_SIGMA_RANGE = (-8.0, 4.0)
INPUT_LIMIT = 8.0  # standard deviations from the mean to which inputs are clipped
UNIT = 0.01  # m, of displacement in the outputs
YIELD_UNIT = 10.0  # 1/m, yarn friction that makes one unit of its output


def array_shapes(
    inputs: int, memory: int, first: int, second: int
) -> dict[str, tuple[int, ...]]:
    """Shapes of the critic's arrays by name, from numbers of inputs, memory and hidden
    units.
    """
    return {
        "mean": (inputs,),
        "whiten": (inputs, inputs),
        "recall": (inputs, memory),
        "recall_bias": (memory,),
        "first": (inputs + memory, first),
        "first_bias": (first,),
        "second": (first, second),
        "second_bias": (second,),
        "last": (second, OUTPUTS),
        "last_bias": (OUTPUTS,),
        "stretch": (4,),
    }


ARRAY_NAMES = tuple(array_shapes(1, 1, 1, 1))


class Belief(NamedTuple):
    """Estimated properties of n strips, each as mean and standard deviation (n, 2).

    `log_bending_length` [ln m], `log_retardation_time` [ln s] and `friction`, ln(1 +
    yield curvature / YIELD_UNIT).
    """

    log_bending_length: Array
    log_retardation_time: Array
    friction: Array

    def first(self) -> dict[str, ParameterEstimate]:
        """Estimated bending length [m], retardation time [s] and yield curvature [1/m]
        of the first strip, by name.
        """
        friction = _exponential(self.friction[0])
        intervals = {
            "bending_length": _exponential(self.log_bending_length[0]),
            "retardation_time": _exponential(self.log_retardation_time[0]),
            "yield_curvature": YIELD_UNIT * np.maximum(friction - 1.0, 0.0),
        }
        return {
            name: ParameterEstimate(*map(float, interval))
            for name, interval in intervals.items()
        }


def _exponential(logarithm: Array) -> Array:
    """Value and one-sigma bounds (3,) from mean and sigma (2,) of the `logarithm`."""
    mean, sigma = logarithm
    bounds: Array = np.exp(mean + np.array([0.0, -sigma, sigma]))
    return bounds


class CriticPrediction(NamedTuple):
    """Prediction of the critic for n folds in progress.

    `displacement` (n,) [m] if the rise stays, its derivative `slope` (n,) by the rise,
    its standard deviation `sigma` (n,) [m], and the `belief` about the strips.
    """

    displacement: Array
    slope: Array
    sigma: Array
    belief: Belief


def median_prediction(predictions: Sequence[CriticPrediction]) -> CriticPrediction:
    """Element-wise median of `predictions`, at least one, for the same folds."""
    *numbers, beliefs = zip(*predictions, strict=True)
    displacement, slope, sigma = (np.median(values, axis=0) for values in numbers)
    belief = Belief(
        *(np.median(values, axis=0) for values in zip(*beliefs, strict=True))
    )
    return CriticPrediction(displacement, slope, sigma, belief)


class FoldMemory:
    """Memory of n folds in progress: the mean of the critic's memory units over their
    images.
    """

    def __init__(self, count: int, units: int) -> None:
        """Empty memory of `count` folds, with `units` values each."""
        self._sums = np.zeros((count, units))
        self._images = np.zeros((count, 1))

    def add(self, units: Array, reached: NDArray[np.bool_]) -> Array:
        """Add one image's `units` (n, units) to the folds marked in `reached` (n,);
        return the means over their images.
        """
        self._sums = self._sums + reached[:, None] * units
        self._images = self._images + reached[:, None]
        return self._sums / np.maximum(self._images, 1)


class Critic:
    """Network with two hidden layers over whitened inputs and the mean of its memory
    units.

    The layer `recall` turns inputs (n, k) into (n, memory) units, whose mean over a
    fold's images is the fold's memory; `predict` reads both. `weights` are the arrays
    called ARRAY_NAMES.
    """

    def __init__(self, weights: dict[str, Array]) -> None:
        self.weights = {
            name: np.asarray(weights[name], dtype=np.float64) for name in ARRAY_NAMES
        }

    @property
    def memory(self) -> int:
        """Number of memory units of the network."""
        return int(self.weights["recall"].shape[1])

    def whiten(self, inputs: Array) -> Array:
        """Decorrelate `inputs` (n, k), scale them to unit variance, clip them to
        +-INPUT_LIMIT.
        """
        return np.clip(
            (inputs - self.weights["mean"]) @ self.weights["whiten"],
            -INPUT_LIMIT,
            INPUT_LIMIT,
        )

    def memorise(self, whitened: Array) -> Array:
        """Activations (n, memory) of memory units by the `whitened` inputs (n, k) of n
        images.
        """
        return np.tanh(whitened @ self.weights["recall"] + self.weights["recall_bias"])

    def predict(self, whitened: Array, memory: Array) -> CriticPrediction:
        """Prediction from `whitened` inputs (n, k) and mean memory units (n,
        memory).
        """
        w = self.weights
        inputs = np.concatenate([whitened, memory], axis=1)
        hidden = np.tanh(inputs @ w["first"] + w["first_bias"])
        hidden = np.tanh(hidden @ w["second"] + w["second_bias"])
        out = hidden @ w["last"] + w["last_bias"]
        sigma = np.exp(np.clip(out[:, LOG_SIGMAS], *LOG_SIGMA_RANGE)) * w["stretch"]
        strip = np.stack([out[:, STRIP_MEANS], sigma[:, 1:]], axis=2)
        return CriticPrediction(
            displacement=UNIT * out[:, DISPLACEMENT],
            slope=np.clip(out[:, SLOPE], SMALLEST_SLOPE, LARGEST_SLOPE),
            sigma=UNIT * sigma[:, 0],
            belief=Belief(strip[:, 0], strip[:, 1], strip[:, 2]),
        )

    def with_stretch(self, stretch: Array) -> Self:
        """Copy of the critic with its four standard deviations multiplied by the
        factors `stretch` (4,).
        """
        return type(self)(self.weights | {"stretch": self.weights["stretch"] * stretch})


# ln of m, bending length at which its term is zero
REFERENCE_LOG_LENGTH = math.log(0.02)
REFERENCE_THICKNESS = 1e-3  # m, thickness at which its term is zero
Coefficient = Annotated[float, Field(gt=-100.0, lt=100.0)]  # as any plausible one is


class Untrained(StudyResult):
    """Extra standard deviation `added` [m] of the critic for effects outside its
    training.

    Examples: another engine, lost images. `python -m tests.lab study unknown` fits it
    to `folds`; of these the shares `within_1` and `within_2` then err by less than 1
    and 1.96 sigma.
    """

    FILE = Path(__file__).with_name("untrained.yaml")
    added: float
    within_1: float
    within_2: float
    folds: int


class CriticBias(Settings):
    """Bias [m] of the critic's displacement, linear in ln bending length and thickness.

    Constant `always` [m], `of_length` [m] per unit of ln bending length, `of_thickness`
    per m of thickness beyond 1 mm. The critic's sigmas are right after multiplication
    by `sigma`; an unmeasured thickness adds `unmeasured` [m], effects outside the
    training add `untrained` [m]. The default corrects nothing, as for folds like those
    of the training.
    """

    always: Coefficient = 0.0
    of_length: Coefficient = 0.0
    of_thickness: Coefficient = 0.0
    sigma: Coefficient = 1.0
    unmeasured: Coefficient = 0.0
    untrained: Coefficient = 0.0

    def estimate(self, belief: Belief, thickness: float | None) -> Array:
        """Bias (n,) [m] of the displacements that the critic predicts for n strips.

        `belief` estimates the strips; their `thickness` [m] is None if unknown.
        """
        beyond = np.array(0.0 if thickness is None else thickness - REFERENCE_THICKNESS)
        terms = bias_terms(belief.log_bending_length[:, 0], beyond)
        bias: Array = terms @ np.array([self.always, self.of_length, self.of_thickness])
        return bias

    def sigma_of(self, sigma: Array, thickness: float | None) -> Array:
        """Corrected standard deviations (n,) [m] of displacements, from the critic's
        `sigma`.
        """
        added = np.hypot(self.untrained, self.unmeasured if thickness is None else 0.0)
        return np.hypot(self.sigma * sigma, added)


def bias_terms(log_length: Array, beyond: Array) -> Array:
    """Regressors (n, 3) of the bias from ln bending length (n,), thickness beyond 1 mm
    (n,) [m].
    """
    length, beyond = np.broadcast_arrays(log_length - REFERENCE_LOG_LENGTH, beyond)
    return np.stack([np.ones_like(length), length, beyond], axis=1)
