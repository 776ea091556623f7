"""Projection of residuals and responses on what the fitted unknowns cannot absorb."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import unknowns
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Projection:
    """Quadratic model of the objective about an estimate, in robustly weighted residuals.

    `residual` (N,) of all runs, the last small step of the fit taken, `jacobian` (N, u) of the
    free unknowns and of nuisance responses, `inverse` (u, u) of their curvature with priors,
    `weight` (N,) that brings whitened residuals to these units. `scatter` (N, q) are the responses
    to the runs' random unknowns, each by its spread.
    """

    residual: Array
    jacobian: Array
    inverse: Array
    weight: Array
    scatter: Array

    def left(self, response: Array) -> Array:
        """Part of `response` (N, ...) that the free unknowns cannot absorb, in weighted units."""
        back = self.inverse @ (self.jacobian.T @ response)
        return np.asarray(response - self.jacobian @ back)

    def weigh(self, whitened: Array) -> Array:
        """Convert a whitened response (N, k) to weighted units."""
        return np.asarray(whitened * self.weight[:, None])

    def form(self, responses: Array) -> normal_equations.Normal:
        """Gradient and curvature of the refitted objective in the amounts of `responses` (N, k).

        At the estimate the unknowns' own gradient vanishes, so that responses D in the amounts a
        change the minimum by a' D' r + a' D' (I - H) D a / 2, H the hat matrix with priors.
        """
        return normal_equations.Normal(
            responses.T @ self.residual, responses.T @ self.left(responses)
        )


def projection(
    estimate: Estimate, *, robustly: bool = True, nuisance: Sequence[Array] = ()
) -> Projection:
    """Quadratic model about `estimate`, in which unknowns on a bound are fixed.

    Whitened responses `nuisance` (N, k) may be there by unknown amounts of one standard deviation.
    """
    limits, z = estimate.limits, estimate.z
    r = np.concatenate(estimate.residuals)
    scale = estimate.scale if robustly else 1.0
    weight = np.sqrt(robust.weights(r / scale)) / scale if robustly else np.ones_like(r)
    free = (z > limits.low) & (z < limits.high)
    whole = stacked_jacobian(estimate)
    jacobian = np.concatenate([whole[:, free], *nuisance], axis=1) * weight[:, None]
    added = (0, jacobian.shape[1] - np.count_nonzero(free))
    precision = np.pad(limits.precision[free], added, constant_values=1.0)
    pull = np.pad((limits.precision * (z - limits.mean))[free], added)
    inverse = normal_equations.covariance(jacobian.T @ jacobian + np.diag(precision))
    settled = r * weight - jacobian @ (inverse @ (jacobian.T @ (r * weight) + pull))
    every = unknowns(estimate.model, estimate.evidence)
    spread = np.array([p.spread if p.random else 0.0 for p in every])
    scatter = (whole * (weight[:, None] * spread))[:, spread > 0.0]
    return Projection(settled, jacobian, inverse, weight, scatter)


def stacked_jacobian(estimate: Estimate) -> Array:
    """Whitened Jacobian (N, size) of all runs in all unknowns."""
    rows = [len(r) for r in estimate.residuals]
    full = np.zeros((sum(rows), estimate.place.size))
    at = 0
    for i, (n, jacobian) in enumerate(zip(rows, estimate.jacobians, strict=True)):
        full[at : at + n, estimate.place.columns(i)] = jacobian
        at += n
    return full
