"""Bending length of a strip from several photographs, straight or with a rest
curvature.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, norm, t

from cell.setup.strips.cantilever_fit import (
    STRAIGHT,
    Fit,
    RestCurvature,
    RestCurvaturePrior,
    fit,
)
from cell.setup.strips.photograph import Photograph
from drivers.base.types import Array

CONFIDENCE = 0.95
# 1/m, rest curvatures that are tried
REST_CURVATURES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
DECISIVE = 5.0  # of log evidence, for a prior with one more unknown

Fits = tuple[Fit, ...]


@dataclass(frozen=True, slots=True)
class Pooled:
    """Mean `value` of several measurements, its 95 % interval [`low`, `high`], their
    `scatter`.

    `scatter` is the standard deviation beyond their own; `agreement` the probability of
    at least this scatter if the measurements' own sigmas were all.
    """

    value: float
    low: float
    high: float
    scatter: float
    agreement: float


def pool(values: Sequence[float], sigmas: Sequence[float]) -> Pooled:
    """Random-effects mean of `values` (n,) with standard deviations `sigmas` (n,).

    Scatter by Paule and Mandel, interval by Hartung and Knapp, never narrower than the
    sigmas alone make it.
    """
    y = np.array(values)
    variance = np.array(sigmas) ** 2
    scatter = _scatter(y, variance)
    weight = 1 / (variance + scatter)
    value = float((weight * y).sum() / weight.sum())
    quantile = 0.5 + CONFIDENCE / 2
    half = float(norm.ppf(quantile) / np.sqrt(weight.sum()))
    agreement = 1.0
    freedom = len(y) - 1
    if freedom:
        agreement = float(chi2.sf(_excess_squares(y, variance, 0.0) + freedom, freedom))
        knapp_variance = (weight * (y - value) ** 2).sum() / (freedom * weight.sum())
        half = max(half, float(t.ppf(quantile, freedom) * np.sqrt(knapp_variance)))
    ends = value - half, value + half
    return Pooled(value, *ends, scatter=float(np.sqrt(scatter)), agreement=agreement)


def _excess_squares(y: Array, variance: Array, scatter: float) -> float:
    """Weighted sum of squares of `y` (n,) about its mean, less its expectation n - 1.

    Weights are the inverse of `variance` (n,) plus the variance `scatter` between
    measurements.
    """
    weight = 1 / (variance + scatter)
    mean = (weight * y).sum() / weight.sum()
    return float((weight * (y - mean) ** 2).sum() - (len(y) - 1))


def _scatter(y: Array, variance: Array) -> float:
    """Variance between measurements at which the sum of squares is as expected
    (Paule-Mandel).
    """
    if len(y) < 2 or _excess_squares(y, variance, 0.0) <= 0:
        return 0.0
    largest = float(np.ptp(y) ** 2) * len(y)  # at which the sum is less than expected
    return float(
        brentq(lambda scatter: _excess_squares(y, variance, scatter), 0.0, largest)
    )


@dataclass(frozen=True, slots=True)
class Bending:
    """Bending length [m] of a strip from all photographs, with the fit of each
    photograph.

    `fits` are with the best rest-curvature prior, `straight` with a straight strip;
    bending lengths [m] pooled over all photographs and for each overhang.
    """

    fits: Fits
    straight: Fits
    bending_length: Pooled
    by_overhang: tuple[tuple[float, Pooled], ...]

    @property
    def prior(self) -> RestCurvaturePrior:
        """Prior of the rest curvature, the same for all photographs."""
        return self.fits[0].prior

    @property
    def curl(self) -> Pooled:
        """Uniform part of the rest curvature [1/m], pooled over the photographs."""
        if self.prior.kind is RestCurvature.STRAIGHT:
            return Pooled(value=0.0, low=0.0, high=0.0, scatter=0.0, agreement=1.0)
        values, sigmas = zip(*(fitted.curl for fitted in self.fits), strict=True)
        return pool(values, sigmas)


def measure_bending(photographs: Sequence[Photograph]) -> Bending:
    """Fit the bending length to all photographs, with a common prior of the rest
    curvature.
    """
    straight = tuple(fit(photograph, STRAIGHT) for photograph in photographs)
    fits = straight
    for kind in (RestCurvature.CURLED, RestCurvature.SET):
        curved = _best_fits(photographs, straight, kind)
        if evidence(curved) > evidence(fits) + DECISIVE:
            fits = curved
    overhang_of = attrgetter("photograph.overhang")
    groups = groupby(sorted(fits, key=overhang_of), key=overhang_of)
    return Bending(
        fits=fits,
        straight=straight,
        bending_length=pool_lengths(fits),
        by_overhang=tuple(
            (overhang, pool_lengths(list(group))) for overhang, group in groups
        ),
    )


def evidence(fits: Sequence[Fit]) -> float:
    """Log probability of all midlines under their common prior of the rest
    curvature.
    """
    return sum(fitted.evidence for fitted in fits)


def pool_lengths(fits: Sequence[Fit]) -> Pooled:
    """Pooled bending length [m] of the `fits`, averaged by logarithms."""
    logs = pool(
        [float(np.log(f.bending_length)) for f in fits], [f.sigma for f in fits]
    )
    value, low, high = np.exp([logs.value, logs.low, logs.high]).tolist()
    return replace(logs, value=value, low=low, high=high)


def _best_fits(
    photographs: Sequence[Photograph], start: Fits, kind: RestCurvature
) -> Fits:
    """Fits of the photographs at the spread of rest curvature with the largest
    evidence.
    """
    candidates: list[Fits] = []
    for spread in REST_CURVATURES:
        start = _fit_all(photographs, RestCurvaturePrior(kind, spread), start)
        candidates.append(start)
    scores = np.array([evidence(fits) for fits in candidates])
    j = int(np.argmax(scores))
    if j in (0, len(REST_CURVATURES) - 1):
        return candidates[j]
    # top of the parabola through three scores; the spreads that were tried double each
    # time
    second_difference = scores[j - 1] - 2 * scores[j] + scores[j + 1]
    shift = float(0.5 * (scores[j - 1] - scores[j + 1]) / second_difference)
    prior = RestCurvaturePrior(kind, REST_CURVATURES[j] * 2**shift)
    refined = _fit_all(photographs, prior, candidates[j])
    return max(refined, candidates[j], key=evidence)


def _fit_all(
    photographs: Sequence[Photograph], prior: RestCurvaturePrior, starts: Fits
) -> Fits:
    """Fits of the photographs under one `prior`, each from the fit of the same one in
    `starts`.
    """
    pairs = zip(photographs, starts, strict=True)
    return tuple(fit(photograph, prior, start) for photograph, start in pairs)
