"""Fits of the base parameters, and responses of runs to effects near a fit."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cell.gap.fitting.gauss_newton import Estimate, linearise, refit, responses_to
from cell.gap.fitting.model import Evidence, Model, Point, evidence, requests
from cell.gap.fitting.normal_equations import covariance
from cell.gap.fitting.tasks import Simulate, run_one
from cell.gap.subject.subject import Candidate, Subject
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

# of the prior spread of a value: runs that leave more do not determine it; set by hand
WEAK = 0.5


def refit_base(simulate: Simulate, model: Model, evidence: Evidence) -> Estimate:
    """Fit of the base parameters of `model`, from stated values, to the runs of
    `evidence`.
    """
    stated = Point(np.array([p.start for p in model.parameters]), evidence.start())
    return run_one(simulate, refit(model, evidence, stated))


def undetermined_values(estimate: Estimate) -> list[tuple[Parameter, float]]:
    """Base parameters whose uncertainty the runs hardly reduce, with standard
    deviations.
    """
    sigma = np.sqrt(np.diag(covariance(estimate.normal().curvature)))
    pairs = zip(estimate.model.base, map(float, sigma), strict=False)
    return [(p, s) for p, s in pairs if s > WEAK * p.spread]


def strains(estimate: Estimate) -> dict[str, float]:
    """Deviations of fitted base values from the stated ones, in prior standard
    deviations.
    """
    pairs = zip(estimate.model.base, estimate.shared, strict=False)
    return {
        p.name: (float(v) - p.start) / p.spread
        for p, v in pairs
        if np.isfinite(p.spread)
    }


def refit_fine(
    subject: Subject, simulate: Simulate, model: Model, coarse: Evidence, start: Point
) -> Estimate:
    """Fit `model`, from `start`, to `coarse` runs corrected for coarse time steps and
    grids.
    """
    return run_one(simulate, refit(model, refine(subject, model, start, coarse), start))


def refine(subject: Subject, model: Model, point: Point, coarse: Evidence) -> Evidence:
    """Runs corrected for the coarse simulation at `point`, with floors for remaining
    errors.
    """
    return evidence(subject.refine(requests(model, coarse.runs, point)))


def stated_estimate(subject: Subject, simulate: Simulate) -> Estimate:
    """Estimate at the stated base values, not fitted, with residuals taken as zero."""
    measured = evidence(subject.runs)
    model = Model(subject.scope.base)
    point = Point(np.array([p.start for p in model.parameters]), measured.start())
    raw, jacobians = run_one(simulate, linearise(model, measured, point))
    fit = Estimate.at(model, measured, point, raw, jacobians)
    return replace(fit, residuals=tuple(map(np.zeros_like, fit.residuals)), scale=1.0)


def effect_responses(
    simulate: Simulate,
    base: Estimate,
    effects: Sequence[tuple[Candidate, Sequence[float]]],
) -> Array:
    """Whitened responses (N, k) of all runs to k effects, each alone with its given
    values.
    """
    models = [(base.model, base.shared)]
    for effect, values in effects:
        shared = np.append(base.shared, effect.complete(np.array(values)))
        models.append((Model(base.model.base, (effect,)), shared))
    by_effect = run_one(simulate, responses_to(base, models))
    return np.array([np.concatenate(by_run) for by_run in by_effect]).T
