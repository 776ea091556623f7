"""Uncertainty of fitted values: noise, run-to-run spreads and errors common to all runs.

Noise and what differs from run to run average out over runs; an error that all runs share does
not. It is no unknown of the fit, which would take it for an effect: its spread, as measured
beforehand, is carried through the fit to the values (a considered parameter: Schmidt 1966,
Application of state-space methods to navigation problems).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.projection import stacked_jacobian
from cell.gap.fitting.spreads import Spread
from cell.gap.subject.subject import Parameter
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Freedom:
    """Settings for the degrees of freedom of a variance. Source: set by hand.

    The logarithm of a spread is changed by `step`; its prior holds as much information as six runs,
    so that there are at least `least`; `most` are as good as infinitely many.
    """

    step: float = 0.1
    least: float = 5.0
    most: float = 1e6


FREEDOM = Freedom()


def covariance(estimate: Estimate, inefficiency: float) -> Array:
    """Covariance (size, size) of all unknowns; `inefficiency` samples count as one independent."""
    inverse = normal_equations.covariance(estimate.normal().curvature)
    errors = _common_error_responses(estimate)
    if not errors.shape[1]:
        return inverse * inefficiency
    scale = estimate.scale
    weight = robust.weights(np.concatenate(estimate.residuals) / scale) / scale**2
    moved = inverse @ (stacked_jacobian(estimate).T @ (weight[:, None] * errors))
    return np.asarray(inverse * inefficiency + moved @ moved.T)


def _common_error_responses(estimate: Estimate) -> Array:
    """Whitened residuals (N, k) caused by one standard deviation of each common error."""
    known = estimate.evidence
    names = list(dict.fromkeys(name for run in known.runs for name in run.common))
    parts = [
        np.array([run.common.get(name, np.zeros(len(scale))) / scale for name in names])
        .reshape(len(names), len(scale))
        .T
        for run, scale in zip(known.runs, known.scales, strict=True)
    ]
    return np.concatenate(parts)


def degrees_of_freedom(estimate: Estimate, inefficiency: float, scatter: Sequence[Spread]) -> Array:
    """Degrees of freedom (size,) of the variance of each unknown, `FREEDOM.least` or more.

    2 V^2 / var V, by how the variance V goes with the logarithm of each spread and how well that
    is known (Satterthwaite 1946, An approximate distribution of estimates of variance components).
    """
    whole = _variance(estimate, inefficiency, {})
    doubt = np.zeros_like(whole)
    for spread in scatter:
        more, less = (
            _variance(estimate, inefficiency, {spread.name: float(np.exp(side * FREEDOM.step))})
            for side in (1.0, -1.0)
        )
        doubt += ((more - less) / (2.0 * FREEDOM.step) * spread.error) ** 2
    return np.clip(2.0 * whole**2 / np.maximum(doubt, 1e-300), FREEDOM.least, FREEDOM.most)


def _variance(estimate: Estimate, inefficiency: float, factors: dict[str, float]) -> Array:
    """Variance (size,) of all unknowns, with spreads multiplied by `factors` by name."""

    def with_factor(p: Parameter) -> Parameter:
        return replace(p, spread=p.spread * factors.get(p.name, 1.0)) if p.random else p

    known = estimate.evidence
    runs = tuple(replace(run, local=tuple(map(with_factor, run.local))) for run in known.runs)
    moved = replace(estimate, evidence=replace(known, runs=runs))
    return np.asarray(np.diag(covariance(moved, inefficiency)))
