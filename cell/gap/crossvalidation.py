"""How well a fitted model predicts runs that it has not seen, condition by condition.

Each fold leaves out whole conditions; frames of one run are never split. The estimate without a
fold is one Newton step from the estimate with it (Giordano et al. 2019, A Swiss Army
infinitesimal jackknife), but the runs left out are then truly simulated, with their own
unknowns adapted to the run.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.gap import quadratic, robust
from cell.gap.batch import Task
from cell.gap.model import Evidence, Model, Point, requests
from cell.gap.refit import Estimate, residuals
from cell.gap.subject import Run
from drivers.types import Array

FOLDS = 8


@dataclass(frozen=True, slots=True)
class Validated:
    """An estimate and what it predicts: whitened residuals (n,) of each run when left out."""

    estimate: Estimate
    left_out: tuple[Array, ...]

    @property
    def model(self) -> Model:
        """The model."""
        return self.estimate.model

    def losses(self, scale: float) -> Array:
        """Predictive loss of each run at a dispersion [nats]."""
        return np.array([float(robust.loss(r / scale).sum()) for r in self.left_out])


def folds(runs: Sequence[Run], most: int = FOLDS) -> list[list[int]]:
    """Run numbers by fold: whole conditions, dealt in turn; single runs where all are alike."""
    conditions = list(dict.fromkeys(run.condition for run in runs))
    label = [conditions.index(run.condition) for run in runs]
    if len(conditions) == 1:
        label = list(range(len(runs)))
    count = min(most, max(label) + 1)
    return [[i for i, c in enumerate(label) if c % count == f] for f in range(count)]


def validate(estimate: Estimate) -> Task[Validated]:
    """Predictive residuals of every run; yields simulations."""
    evidence, model = estimate.evidence, estimate.model
    points: list[Point] = [Point(estimate.shared, ())] * len(evidence.runs)
    for fold in folds(evidence.runs):
        shared = _without(estimate, fold)
        for i in fold:
            points[i] = Point(shared, (_adapted(estimate, i, shared),))
    first = yield from _simulated(model, evidence, points)
    if all(len(run.local) == 0 for run in evidence.runs):
        return Validated(estimate, first)
    again = [
        Point(p.shared, (p.local[0] + _correction(estimate, i, first[i]),))
        for i, p in enumerate(points)
    ]
    second = yield from _simulated(model, evidence, again)
    best = tuple(
        a if robust.loss(a).sum() <= robust.loss(b).sum() else b
        for a, b in zip(first, second, strict=True)
    )
    return Validated(estimate, best)


def _simulated(
    model: Model, evidence: Evidence, points: Sequence[Point]
) -> Task[tuple[Array, ...]]:
    asked = []
    for run, point in zip(evidence.runs, points, strict=True):
        asked += requests(model, [run], point)
    raw = yield asked
    return residuals(raw, evidence)


def _without(estimate: Estimate, fold: Sequence[int]) -> Array:
    """Shared values with the runs of `fold` taken out, by one bounded Newton step."""
    keep = [i for i in range(len(estimate.evidence.runs)) if i not in fold]
    names = [estimate.evidence.runs[i].name for i in keep]
    kept = estimate.evidence.of(names)
    place = quadratic.layout(estimate.model, kept)
    limits = quadratic.bounds(estimate.model, kept)
    point = Point(estimate.shared, tuple(estimate.point.local[i] for i in keep))
    z = place.packed(point)
    data = quadratic.normal(
        place,
        [estimate.residuals[i] for i in keep],
        [estimate.jacobians[i] for i in keep],
        estimate.scale,
    )
    step = quadratic.bounded_step(quadratic.with_prior(data, z, limits), z, limits)
    return estimate.shared + step[: place.shared]


def _adapted(estimate: Estimate, i: int, shared: Array) -> Array:
    """The run's own unknowns, moved with the shared values."""
    jacobian = estimate.jacobians[i]
    count = len(estimate.shared)
    moved = estimate.residuals[i] + jacobian[:, :count] @ (shared - estimate.shared)
    return estimate.point.local[i] + _correction(estimate, i, moved)


def _correction(estimate: Estimate, i: int, r: Array) -> Array:
    own = estimate.jacobians[i][:, len(estimate.shared) :]
    if own.shape[1] == 0:
        return np.zeros(0)
    weight = robust.weights(r / estimate.scale)[:, None]
    spread = np.array([p.spread for p in estimate.evidence.runs[i].local])
    curvature = (own * weight).T @ own / estimate.scale**2 + np.diag(spread**-2)
    gradient = (own * weight).T @ r / estimate.scale**2
    return np.asarray(-np.linalg.solve(curvature, gradient))
