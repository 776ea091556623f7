"""The base refitted from several starts, and what the runs cannot determine of it."""

from dataclasses import dataclass

import numpy as np

from cell.gap.fitting import normal_equations
from cell.gap.fitting.gauss_newton import ROUGH_GAIN, Estimate, refit
from cell.gap.fitting.model import Evidence, Model, Point, evidence, requests
from cell.gap.fitting.projection import stacked_jacobian
from cell.gap.fitting.secants import linearise
from cell.gap.fitting.tasks import Simulate, run_all, run_one
from cell.gap.subject.subject import Subject
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Starts:
    """From how many values the base is fitted, the stated ones among them, and in how many `steps`
    a drawn start comes farther than those or never. Source: set by hand.
    """

    count: int = 3
    steps: int = 4


STARTS = Starts()


def refit_base(
    simulate: Simulate, model: Model, evidence: Evidence, rng: np.random.Generator
) -> Estimate:
    """Best of the fits from the stated values and, where that one leaves more than noise, from
    values drawn around them: those that do not come farther in a few steps are given up.
    """
    nominal = np.array([p.start for p in model.parameters])
    first = run_one(simulate, refit(model, evidence, Point(nominal, evidence.start())))
    if all(np.mean(r**2) < 1.0 for r in first.residuals):
        return first
    points = [_draw_start(model, rng) for _ in range(STARTS.count - 1)]
    tasks = [
        refit(model, evidence, Point(p, evidence.start()), None, ROUGH_GAIN, STARTS.steps)
        for p in points
    ]
    begun = best([first, *run_all(simulate, tasks)])
    if begun is first:
        return first
    return best([first, run_one(simulate, refit(model, evidence, begun.point, begun.jacobians))])


def best(estimates: list[Estimate]) -> Estimate:
    """The estimate of the smallest objective, all judged at the smallest dispersion."""
    scale = min(e.scale for e in estimates)
    return min(estimates, key=lambda e: objective_of(e, scale))


def objective_of(estimate: Estimate, scale: float) -> float:
    """Objective of an estimate at a given dispersion [nats]."""
    return normal_equations.objective(estimate.residuals, estimate.z, estimate.limits, scale)


def _draw_start(model: Model, rng: np.random.Generator) -> Array:
    """Values within what was known before, off the bounds."""
    values = []
    for p in model.parameters:
        width = p.spread if np.isfinite(p.spread) else 0.25 * (p.high - p.low)
        low, high = max(p.low, p.start - width), min(p.high, p.start + width)
        values.append(low + (high - low) * rng.uniform(0.1, 0.9))
    return np.array(values)


def weak_directions(estimate: Estimate) -> list[str]:
    """Directions of shared parameters of which the runs say less than was known before, in words:
    those with singular values below one, weakest first.

    Singular values of the whitened Jacobian, runs' own unknowns projected out, each parameter in
    units of what was known of it (Brun, Reichert, Kuensch 2001, identifiability analysis).
    """
    parameters = estimate.model.parameters
    jacobian = stacked_jacobian(estimate) / estimate.scale
    shared, local = jacobian[:, : len(parameters)], jacobian[:, len(parameters) :]
    if local.size:
        q, _ = np.linalg.qr(local)
        shared = shared - q @ (q.T @ shared)
    widths = [p.spread if np.isfinite(p.spread) else 0.25 * (p.high - p.low) for p in parameters]
    _, singular, directions = np.linalg.svd(shared * np.array(widths), full_matrices=False)
    names = [p.name for p in parameters]
    rows = zip(singular[::-1], directions[::-1], strict=True)
    return [_words(names, row) for s, row in rows if s < 1.0]


def _words(names: list[str], direction: Array) -> str:
    order = np.argsort(-np.abs(direction))
    main = [i for i in order if abs(direction[i]) > 0.3]
    sign = np.sign(direction[main[0]])
    parts = [("+ " if direction[i] * sign > 0 else "- ") + names[i] for i in main]
    return " ".join(parts).removeprefix("+ ")


def refit_fine(subject: Subject, simulate: Simulate, rough: Estimate) -> Estimate:
    """The fit on runs that are corrected for the grain of simulation at its own values, with the
    scales of the rough one: all models are judged by the same.
    """
    runs = refine(subject, rough.model, rough.point, rough.evidence).runs
    return run_one(simulate, refit(rough.model, Evidence(runs, rough.evidence.scales), rough.point))


def refit_base_fine(subject: Subject, simulate: Simulate, rough: Estimate) -> Estimate:
    """The fit of the base as by `refit_fine`, with the scales that the grain there leaves."""
    runs = refine(subject, rough.model, rough.point, rough.evidence)
    return run_one(simulate, refit(rough.model, runs, rough.point))


def refine(subject: Subject, model: Model, point: Point, known: Evidence) -> Evidence:
    """The runs corrected for the grain of simulation at `point`, whitened by what that leaves."""
    return evidence(subject.refine(requests(model, known.runs, point)))


def nominal(subject: Subject, simulate: Simulate) -> Estimate:
    """The base of `subject` at the values of its file, from which other responses are judged."""
    known, model = evidence(subject.runs), Model(subject.scope.base)
    point = Point(np.array([p.start for p in model.parameters]), known.start())
    raw, jacobians = run_one(simulate, linearise(model, known, point))
    nothing = tuple(np.zeros(len(r.mean)) for r in raw)
    return Estimate(model, known, point, nothing, tuple(raw), jacobians, 1.0, 0.0)
