"""How well the width of an interval is known, where it rests on spreads of few runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.fitting import common_errors
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.spreads import Spread
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Freedom:
    """How the degrees of freedom of a variance are found. Source: set by hand.

    The logarithm of a spread is moved by `step`; what is usual in laboratories says as much of a
    spread as six runs do, so that there are `least`; `most` are as good as infinitely many.
    """

    step: float = 0.1
    least: float = 5.0
    most: float = 1e6


FREEDOM = Freedom()


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
    """Variance (size,) of all unknowns with spreads times `factors`, by name."""
    runs = tuple(
        replace(
            run,
            local=tuple(
                replace(p, spread=p.spread * factors.get(p.name, 1.0)) if p.random else p
                for p in run.local
            ),
        )
        for run in estimate.evidence.runs
    )
    known = replace(estimate, evidence=replace(estimate.evidence, runs=runs))
    return np.asarray(np.diag(common_errors.covariance(known, inefficiency)))
