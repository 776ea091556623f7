"""How sure fitted values are where measuring errs alike in all runs.

Noise and what differs from run to run average out over runs; an error that all runs share does
not. It is no unknown of the fit, which would take it for an effect: its spread, as measured
beforehand, is carried through the fit to the values (a considered parameter: Schmidt 1966,
Application of state-space methods to navigation problems).
"""

import numpy as np

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.projection import stacked_jacobian
from drivers.types import Array


def covariance(estimate: Estimate, inefficiency: float) -> Array:
    """Covariance (size, size) of all unknowns; `inefficiency` samples count as one independent."""
    inverse = normal_equations.covariance(estimate.normal())
    errors = responses(estimate)
    if not errors.shape[1]:
        return inverse * inefficiency
    scale = estimate.scale
    weight = robust.weights(np.concatenate(estimate.residuals) / scale) / scale**2
    moved = inverse @ (stacked_jacobian(estimate).T @ (weight[:, None] * errors))
    return np.asarray(inverse * inefficiency + moved @ moved.T)


def responses(estimate: Estimate) -> Array:
    """Whitened residuals (N, k) that one sigma of each of the k common errors makes."""
    known = estimate.evidence
    names = list(dict.fromkeys(name for run in known.runs for name in run.common))
    parts = [
        np.array([run.common.get(name, np.zeros(len(scale))) / scale for name in names])
        .reshape(len(names), len(scale))
        .T
        for run, scale in zip(known.runs, known.scales, strict=True)
    ]
    return np.concatenate(parts)
