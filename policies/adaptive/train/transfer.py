"""Fit of a critic's transfer to the folds that its policy made through images."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from drivers.types import Array
from policies.adaptive.bias import THICKNESS, Bias, bias_terms
from policies.adaptive.roll import MOST, TERMS, Roll, roll_terms
from policies.adaptive.transfer import Transfer

PRIOR = np.array([2e-3, 2e-3, 2.0])  # sigma of the bias: m, m, m/m
SMOOTH = 5e-3  # m, sigma of a weight of the roll
NOISE = 0.7e-3  # m, of one fold, against which the priors count
WILD = 1.5e-3  # m from which on a fold begins to count less
WITHIN = 0.68  # share of folds within one sigma


class FoldedBatch(NamedTuple):
    """Folds (n,): displacement and final offset of the edges as they were, displacement and sigma
    as the critic predicted them, the belief's logarithms, and the thickness [m].
    """

    displacement: Array
    edges: Array
    predicted: Array
    sigma: Array
    log_length: Array
    log_time: Array
    friction: Array
    thickness: Array

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, float]]) -> Self:
        """The folds of `rows`, each with these fields."""
        return cls(*(np.array([row[name] for row in rows], dtype=float) for name in cls._fields))


@dataclass(frozen=True, slots=True)
class FitQuality:
    """Number of `folds`, rms of what `bias` and `roll` leave of folds that were left out [m], and
    the share of displacements `within` one sigma.
    """

    folds: int
    bias: float
    roll: float
    within: float

    def facts(self) -> dict[str, Any]:
        """For the checkpoint."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def fit_transfer(batch: FoldedBatch) -> tuple[Transfer, FitQuality]:
    """The transfer by `batch`, and how well it holds for folds that were left out, a tenth each
    time. Raises ValueError for fewer folds than the roll has terms.
    """
    count = len(batch.displacement)
    if count < TERMS:
        raise ValueError(f"{count} folds; the fit needs {TERMS}")
    left_bias, left_roll = np.empty(count), np.empty(count)
    for part in np.array_split(np.random.default_rng(0).permutation(count), min(count, 10)):
        rest = np.setdiff1d(np.arange(count), part)
        bias, roll = _coefficients(_chosen(batch, rest))
        left_bias[part], left_roll[part] = _residuals(_chosen(batch, part), bias, roll)
    bias, roll = _coefficients(batch)
    sigma = float(np.quantile(np.abs(left_bias) / batch.sigma, WITHIN))
    unmeasured = abs(bias[2]) * float(np.sqrt(np.mean((batch.thickness - THICKNESS) ** 2)))
    transfer = Transfer(
        Bias(*(_short(value) for value in (*bias, sigma, unmeasured))),
        Roll(tuple(map(_short, roll))),
    )
    quality = FitQuality(
        count,
        _short(np.sqrt(np.mean(left_bias**2))),
        _short(np.sqrt(np.mean(left_roll**2))),
        round(float(np.mean(np.abs(left_bias) < sigma * batch.sigma)), 3),
    )
    return transfer, quality


def _coefficients(batch: FoldedBatch) -> tuple[Array, Array]:
    """Posterior modes of the bias (3,) and of the roll's weights (TERMS,)."""
    bias = _mode(_bias_terms(batch), batch.predicted - batch.displacement, PRIOR, -np.inf, np.inf)
    spread = np.full(TERMS, SMOOTH)
    return bias, _mode(_roll_terms(batch), batch.edges - batch.displacement, spread, 0.0, MOST)


def _mode(terms: Array, values: Array, prior: Array, low: float, high: float) -> Array:
    """Weights by which `terms` (n, k), kept within `low` and `high`, give `values` (n,)."""

    def residuals(scaled: Array) -> Array:
        off = (np.clip(terms @ (scaled * prior), low, high) - values) / NOISE
        wild = WILD / NOISE
        return np.concatenate([wild * np.arcsinh(off / wild), scaled])

    rows = np.vstack([terms * prior / NOISE, np.eye(len(prior))])
    start = np.linalg.lstsq(rows, np.concatenate([values / NOISE, 0.0 * prior]), rcond=None)[0]
    return np.asarray(optimize.least_squares(residuals, start).x * prior)


def _residuals(batch: FoldedBatch, bias: Array, roll: Array) -> tuple[Array, Array]:
    rolled = np.clip(_roll_terms(batch) @ roll, 0.0, MOST)
    off = batch.displacement - batch.predicted + _bias_terms(batch) @ bias
    return off, batch.edges - batch.displacement - rolled


def _bias_terms(batch: FoldedBatch) -> Array:
    return bias_terms(batch.log_length, batch.thickness - THICKNESS)


def _roll_terms(batch: FoldedBatch) -> Array:
    return roll_terms(batch.log_length, batch.log_time, batch.friction)


def _chosen(batch: FoldedBatch, rows: NDArray[np.intp]) -> FoldedBatch:
    return FoldedBatch(*(column[rows] for column in batch))


def _short(value: float) -> float:
    return float(f"{value:.4g}")
