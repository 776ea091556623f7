"""Parts of residuals and responses that a refit of the unknowns cannot absorb."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.gap.fitting import robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.normal_equations import NormalEquations, covariance
from drivers.base.types import Array


@dataclass(frozen=True, slots=True)
class Projection:
    """Linear map that removes from responses the part that a refit of all unknowns
    absorbs.

    `residual` (N,) of all runs, the last small step of the fit taken, `jacobian` (N, u)
    of the free unknowns and of nuisance responses, `inverse` (u, u) of their curvature
    with priors, `weight` (N,) that brings whitened residuals to these units. `scatter`
    (N, q) are the responses to the runs' random unknowns, each by its spread.
    """

    residual: Array
    jacobian: Array
    inverse: Array
    weight: Array
    scatter: Array

    def unabsorbed(self, response: Array) -> Array:
        """Part of `response` (N, ...) that a refit of the unknowns leaves, in weighted
        units.
        """
        back = self.inverse @ (self.jacobian.T @ response)
        return np.asarray(response - self.jacobian @ back)

    def weigh(self, whitened: Array) -> Array:
        """Whitened response (N, k) times the square roots of the samples' robust
        weights.
        """
        return np.asarray(whitened * self.weight[:, None])

    def form(self, responses: Array) -> NormalEquations:
        """Normal equations in the amounts of `responses` (N, k), all other unknowns
        refitted.

        At the estimate the unknowns' own gradient vanishes, so that responses D in the
        amounts a change the minimum by a' D' r + a' D' (I - H) D a / 2, H the hat
        matrix with priors.
        """
        left = self.unabsorbed(responses)
        return NormalEquations(responses.T @ self.residual, responses.T @ left)


def projection(
    estimate: Estimate, *, robustly: bool = True, nuisance: Sequence[Array] = ()
) -> Projection:
    """Projection about `estimate`, in which unknowns on a bound are fixed.

    Whitened responses `nuisance` (N, k) may be there by unknown amounts of one standard
    deviation.
    """
    unknowns, z = estimate.unknowns, estimate.z
    r = estimate.stacked_residuals
    scale = estimate.scale if robustly else 1.0
    weight = np.sqrt(robust.weights(r / scale)) / scale if robustly else np.ones_like(r)

    free = (z > unknowns.low) & (z < unknowns.high)
    whole = estimate.stacked_jacobian
    jacobian = np.concatenate([whole[:, free], *nuisance], axis=1) * weight[:, None]
    # a nuisance's amount has mean 0 and standard deviation 1
    added = (0, jacobian.shape[1] - np.count_nonzero(free))
    precision = np.pad(unknowns.precision[free], added, constant_values=1.0)
    pull = np.pad((unknowns.precision * (z - unknowns.mean))[free], added)

    inverse = covariance(jacobian.T @ jacobian + np.diag(precision))
    step = inverse @ (jacobian.T @ (r * weight) + pull)
    settled = r * weight - jacobian @ step

    spread = np.array([p.spread if p.random else 0.0 for p in unknowns.parameters])
    scatter = (whole * (weight[:, None] * spread))[:, spread > 0.0]
    return Projection(
        residual=settled,
        jacobian=jacobian,
        inverse=inverse,
        weight=weight,
        scatter=scatter,
    )
