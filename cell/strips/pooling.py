"""Several measurements of one quantity: their mean, its interval, and whether they agree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, norm, t

from drivers.types import Array

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Pooled:
    """A `value` within [`low`, `high`] at 95 %, and the `scatter` between the measurements.

    `scatter` is the standard deviation beyond their own; `agreement` the probability that
    measurements that differ by their own sigma alone scatter as much.
    """

    value: float
    low: float
    high: float
    scatter: float
    agreement: float


def pool(values: Sequence[float], sigmas: Sequence[float]) -> Pooled:
    """Random-effects mean of `values` with standard deviations `sigmas`.

    Scatter by Paule and Mandel, interval by Hartung and Knapp, never narrower than the sigmas
    alone make it.
    """
    y, variance = np.array(values), np.array(sigmas) ** 2
    scatter = _scatter(y, variance)
    weight = 1 / (variance + scatter)
    value = float((weight * y).sum() / weight.sum())
    own = float(norm.ppf(0.5 + CONFIDENCE / 2) / np.sqrt(weight.sum()))
    free = len(y) - 1
    agreement = float(chi2.sf(_excess(y, variance, 0.0) + free, free)) if free else 1.0
    spread = 0.0
    if free:
        knapp = (weight * (y - value) ** 2).sum() / (free * weight.sum())
        spread = float(t.ppf(0.5 + CONFIDENCE / 2, free) * np.sqrt(knapp))
    half = max(own, spread)
    return Pooled(value, value - half, value + half, float(np.sqrt(scatter)), agreement)


def _excess(y: Array, variance: Array, scatter: float) -> float:
    """Generalised sum of squares over what it is expected to be."""
    weight = 1 / (variance + scatter)
    mean = (weight * y).sum() / weight.sum()
    return float((weight * (y - mean) ** 2).sum() - (len(y) - 1))


def _scatter(y: Array, variance: Array) -> float:
    """Variance between the measurements at which the sum of squares is as expected."""
    if len(y) < 2 or _excess(y, variance, 0.0) <= 0:
        return 0.0
    most = float(np.ptp(y) ** 2) * len(y)
    return float(brentq(lambda scatter: _excess(y, variance, scatter), 0.0, most))
