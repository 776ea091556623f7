"""Predictions of a policy on the fold and the strip, for the record and the
operator.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimated parameter of the simulated rod that a policy steers by, with a 68 %
    interval.

    It absorbs effects that the rod lacks, so it is effective: on the twin the interval
    contains the strip's true bending length in a third of the folds (the laboratory's
    study `unknown`).
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class FoldPrediction:
    """Prediction of a fold's `displacement` and its standard deviation `sigma` [m].

    With estimates of the strip's bending length [m], retardation time [s] and yield
    curvature of yarn friction [1/m]. With `blind` no image is reliable at present.
    """

    displacement: float
    sigma: float
    bending_length: Estimate
    retardation_time: Estimate
    yield_curvature: Estimate
    blind: bool

    def sentence(self) -> str:
        """Text with the predicted displacement and its sigma, for the operator."""
        distance, sigma = 1e3 * self.displacement, 1e3 * self.sigma
        return f"predicted displacement {distance:+.1f} mm, sigma {sigma:.1f} mm"


@runtime_checkable
class Predictor(Protocol):
    """Protocol of a policy that predicts the result of its fold."""

    def prediction(self) -> FoldPrediction | None:
        """Prediction for the first fold of the batch; None before the first
        decision.
        """
