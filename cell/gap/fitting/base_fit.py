"""Fits of the base parameters, and the combinations of them that the runs do not determine."""

import numpy as np

from cell.gap.fitting.gauss_newton import Estimate, linearise, refit
from cell.gap.fitting.model import Evidence, Model, Point, evidence, requests
from cell.gap.fitting.tasks import Simulate, run_one
from cell.gap.subject.subject import Parameter, Subject
from drivers.types import Array

MAIN_PART = 0.3  # of a unit direction, from which on its words name a parameter; set by hand


def refit_base(simulate: Simulate, model: Model, evidence: Evidence) -> Estimate:
    """Fit of the base parameters of `model`, from stated values, to the runs of `evidence`."""
    stated = Point(np.array([p.start for p in model.parameters]), evidence.start())
    return run_one(simulate, refit(model, evidence, stated))


def _prior_width(p: Parameter) -> float:
    """Prior standard deviation of a parameter; a quarter of its range where the prior is flat."""
    return p.spread if np.isfinite(p.spread) else 0.25 * (p.high - p.low)


def weak_directions(estimate: Estimate) -> list[str]:
    """Parameter combinations, in words, that the runs determine less than their priors do.

    The weakest first: those with singular values below one of the whitened Jacobian, runs' own
    unknowns projected out, each parameter in units of its prior width (Brun, Reichert, Kuensch
    2001, identifiability analysis).
    """
    parameters = estimate.model.parameters
    jacobian = estimate.stacked_jacobian / estimate.scale
    shared, local = jacobian[:, : len(parameters)], jacobian[:, len(parameters) :]
    if local.size:
        q, _ = np.linalg.qr(local)
        shared = shared - q @ (q.T @ shared)
    widths = [_prior_width(p) for p in parameters]
    _, singular, directions = np.linalg.svd(shared * np.array(widths), full_matrices=False)
    names = [p.name for p in parameters]
    weakest_first = zip(singular[::-1], directions[::-1], strict=True)
    return [_direction_words(names, row) for s, row in weakest_first if s < 1.0]


def _direction_words(names: list[str], direction: Array) -> str:
    """Signed sum of the main parameters of a direction (P,), such as `mass - length`."""
    order = np.argsort(-np.abs(direction))
    main = [i for i in order if abs(direction[i]) > MAIN_PART]
    sign = np.sign(direction[main[0]])
    parts = [("+ " if direction[i] * sign > 0 else "- ") + names[i] for i in main]
    return " ".join(parts).removeprefix("+ ")


def strains(estimate: Estimate) -> dict[str, float]:
    """Deviations of fitted base values from the stated ones, in prior standard deviations."""
    pairs = zip(estimate.model.base, estimate.shared, strict=False)
    return {p.name: (float(v) - p.start) / p.spread for p, v in pairs if np.isfinite(p.spread)}


def refit_fine(subject: Subject, simulate: Simulate, rough: Estimate) -> Estimate:
    """Refit the estimate `rough` to runs that are corrected for coarse time steps and grids."""
    runs = refine(subject, rough.model, rough.point, rough.evidence)
    return run_one(simulate, refit(rough.model, runs, rough.point))


def refine(subject: Subject, model: Model, point: Point, coarse: Evidence) -> Evidence:
    """Runs with residuals corrected for the coarse simulation at `point`, and its error floors."""
    return evidence(subject.refine(requests(model, coarse.runs, point)))


def stated_estimate(subject: Subject, simulate: Simulate) -> Estimate:
    """Estimate at the stated values of the base, not fitted: its residuals are taken as zero."""
    known, model = evidence(subject.runs), Model(subject.scope.base)
    point = Point(np.array([p.start for p in model.parameters]), known.start())
    raw, jacobians = run_one(simulate, linearise(model, known, point))
    nothing = tuple(np.zeros(len(r.mean)) for r in raw)
    return Estimate(model, known, point, nothing, tuple(raw), jacobians, 1.0, 0.0)
