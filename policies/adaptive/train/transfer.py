"""Fit of the critic's correction, a `CriticBias`, to folds that were made through
images.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from drivers.base.types import Array
from policies.adaptive.critic import REFERENCE_THICKNESS, CriticBias, bias_terms

PRIOR = np.array([2e-3, 2e-3, 2.0])  # sigma of the bias: m, m, m/m
# m, one sigma of a fold's error, which weighs data against the prior
FOLD_NOISE = 0.7e-3
OUTLIER_ERROR = 1.5e-3  # m, error from which a fold is weighted down
COVERAGE = 0.68  # share of folds within one sigma
PARTS = 10  # of the cross-validation


class FoldedBatch(NamedTuple):
    """Displacements and critic's predictions (n,) of n folds through images, to fit its
    bias.

    Measured displacement [m], the critic's prediction and sigma [m], its estimate of
    the bending length as a logarithm, and thickness [m].
    """

    displacement: Array
    predicted: Array
    sigma: Array
    log_length: Array
    thickness: Array

    @classmethod
    def from_rows(cls, rows: Sequence[Mapping[str, float]]) -> Self:
        """Batch of folds from `rows`, one per fold, which map each field to its
        value.
        """
        return cls(
            *(
                np.array([row[name] for row in rows], dtype=float)
                for name in cls._fields
            )
        )


@dataclass(frozen=True, slots=True)
class FitQuality:
    """Quality of a fitted bias: number of `folds` and cross-validated `rms` error
    [m].
    """

    folds: int
    rms: float


def fit_transfer(batch: FoldedBatch) -> tuple[CriticBias, FitQuality]:
    """Fit the critic's bias to the folds of `batch`; also returns its cross-validated
    quality.
    """
    always, of_length, of_thickness = _coefficients(batch)
    errors = _cross_validated_errors(batch)
    bias = CriticBias(
        always=_round(always),
        of_length=_round(of_length),
        of_thickness=_round(of_thickness),
        sigma=_round(np.quantile(np.abs(errors) / batch.sigma, COVERAGE)),
        unmeasured=_round(
            abs(of_thickness) * _rms(batch.thickness - REFERENCE_THICKNESS)
        ),
    )
    return bias, FitQuality(len(errors), _round(_rms(errors)))


def _cross_validated_errors(batch: FoldedBatch) -> Array:
    """Errors (n,) [m] of the displacements predicted for n folds, each corrected by a
    bias fitted to folds of other tenths.
    """
    count = len(batch.displacement)
    errors = np.empty(count)
    for part in np.array_split(
        np.random.default_rng(0).permutation(count), min(count, PARTS)
    ):
        fitted = np.setdiff1d(np.arange(count), part)
        held_out = _subset(batch, part)
        bias = _coefficients(_subset(batch, fitted))
        errors[part] = (
            held_out.displacement - held_out.predicted + _bias_terms(held_out) @ bias
        )
    return errors


def _coefficients(batch: FoldedBatch) -> Array:
    """Posterior mode (3,) of the bias's coefficients [m, m, m/m]."""
    terms = _bias_terms(batch)
    values = batch.predicted - batch.displacement

    def residuals(scaled: Array) -> Array:
        error = (terms @ (scaled * PRIOR) - values) / FOLD_NOISE
        linear = OUTLIER_ERROR / FOLD_NOISE  # errors up to this count in full
        return np.concatenate([linear * np.arcsinh(error / linear), scaled])

    rows = np.vstack([terms * PRIOR / FOLD_NOISE, np.eye(len(PRIOR))])
    start = np.linalg.lstsq(
        rows, np.concatenate([values / FOLD_NOISE, 0.0 * PRIOR]), rcond=None
    )[0]
    coefficients: Array = optimize.least_squares(residuals, start).x * PRIOR
    return coefficients


def _bias_terms(batch: FoldedBatch) -> Array:
    return bias_terms(batch.log_length, batch.thickness - REFERENCE_THICKNESS)


def _subset(batch: FoldedBatch, rows: NDArray[np.intp]) -> FoldedBatch:
    return FoldedBatch(*(column[rows] for column in batch))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _round(value: float) -> float:
    return float(f"{value:.4g}")
