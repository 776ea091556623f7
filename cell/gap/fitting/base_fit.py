"""Fits of the base parameters, and responses of runs to effects near a fit."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cell.gap.fitting import Simulate, robust, run_one
from cell.gap.fitting.gauss_newton import FitEstimate, linearise, refit, responses_to
from cell.gap.fitting.model import Model, Point, requests, stated
from cell.gap.fitting.normal_equations import NormalEquations, covariance
from cell.gap.subject.subject import Candidate, FitRun, Subject, starts
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

# of the prior spread of a value: runs that leave more do not determine it; set by hand
WEAK = 0.5


def refit_base(simulate: Simulate, model: Model, runs: Sequence[FitRun]) -> FitEstimate:
    """Fit of the base parameters of `model`, from stated values, to `runs`."""
    start = stated(runs, starts(model.base))
    return run_one(simulate, refit(model, runs, start))


def undetermined_values(estimate: FitEstimate) -> list[tuple[Parameter, float]]:
    """Base parameters whose uncertainty the runs hardly reduce, each with its standard
    deviation after the fit.
    """
    sigma = np.sqrt(np.diag(covariance(estimate.normal().curvature)))
    pairs = zip(estimate.model.base, sigma, strict=False)
    return [(p, s) for p, s in pairs if s > WEAK * p.spread]


def strains(estimate: FitEstimate) -> dict[str, float]:
    """Deviation of each fitted base value from its stated one, by name, in standard
    deviations of its prior.
    """
    pairs = zip(estimate.model.base, estimate.shared, strict=False)
    return {p.name: (v - p.start) / p.spread for p, v in pairs if np.isfinite(p.spread)}


def refit_fine(
    subject: Subject,
    simulate: Simulate,
    model: Model,
    coarse: Sequence[FitRun],
    start: Point,
) -> FitEstimate:
    """Fit `model`, from `start`, to the runs that are `coarse`, once their residuals
    are corrected by a finer simulation.
    """
    runs = subject.refine(requests(model, coarse, start))
    return run_one(simulate, refit(model, runs, start))


def stated_estimate(subject: Subject, simulate: Simulate) -> FitEstimate:
    """Estimate of the subject's base parameters at their stated values, without a fit
    and with residuals taken as zero.
    """
    runs = subject.runs
    base = subject.scope.base
    model = Model(base)
    point = stated(runs, starts(base))
    raw, jacobians = run_one(simulate, linearise(model, runs, point))
    fit = FitEstimate.at(model, runs, point, raw, jacobians)
    return replace(fit, residuals=[*map(np.zeros_like, fit.residuals)], scale=1.0)


def effect_responses(
    simulate: Simulate,
    base: FitEstimate,
    effects: Sequence[tuple[Candidate, Sequence[float]]],
) -> Array:
    """Whitened responses (samples, k) of all runs to k effects, each added alone to the
    `base` fit with its given values.
    """
    models = [(base.model, base.shared)]
    for effect, values in effects:
        with_effect = Model(base.model.base, (effect,))
        amounts = effect.complete(np.array(values))
        models.append((with_effect, np.append(base.shared, amounts)))

    responses = run_one(simulate, responses_to(base, models))
    columns = [np.concatenate(response_by_run) for response_by_run in responses]
    return np.stack(columns, axis=1)


class Projection(NamedTuple):
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
        """Part of `response` (samples, ...) that a refit of all unknowns leaves, in
        weighted units.
        """
        back = self.inverse @ (self.jacobian.T @ response)
        return response - self.jacobian @ back

    def weigh(self, whitened: Array) -> Array:
        """Whitened response (samples, k) multiplied by the square roots of the samples'
        robust weights.
        """
        return whitened * self.weight[:, None]

    def form(self, responses: Array) -> NormalEquations:
        """Normal equations in the amounts of k effects with `responses` (samples, k),
        all other unknowns being refitted.

        At the estimate the unknowns' own gradient vanishes, so that responses D in the
        amounts a change the minimum by a' D' r + a' D' (I - H) D a / 2, H the hat
        matrix with priors.
        """
        left = self.unabsorbed(responses)
        return NormalEquations(responses.T @ self.residual, responses.T @ left)


def projection(
    estimate: FitEstimate, *, robustly: bool = True, nuisance: Sequence[Array] = ()
) -> Projection:
    """Projection about `estimate` that removes what a refit of its unknowns absorbs;
    unknowns on a bound stay fixed.

    Whitened responses `nuisance` (N, k) may be there by unknown amounts of one standard
    deviation.
    """
    unknowns = estimate.unknowns
    z = estimate.z
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
