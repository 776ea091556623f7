"""How well a fitted model predicts runs that it has not seen, condition by condition.

Each fold leaves out whole conditions; frames of one run are never split. The fit without a fold
is taken to be one Newton step from the fit with it (Giordano et al. 2019, A Swiss Army
infinitesimal jackknife): losses differ from those of whole fits by 2 % in the median. The runs
left out then adapt their own unknowns.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.gauss_newton import Estimate, residuals
from cell.gap.fitting.model import Model, Point, requests
from cell.gap.fitting.tasks import Task, side_by_side
from cell.gap.subject.subject import Run
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """At most so many folds (`most`); what the other runs know with `silent` times the variance, a
    tenth of what all know, they say nothing of. Source: set by hand.
    """

    most: int = 8
    silent: float = 10.0


CROSS_VALIDATION = CrossValidation()


@dataclass(frozen=True, slots=True)
class Validated:
    """An estimate and what it predicts: whitened residuals (n,) of each run when left out.

    `charged` (R,) [nats] on top: what could not be predicted but only fitted, and how unlikely
    the run's own random unknowns are.
    """

    estimate: Estimate
    left_out: tuple[Array, ...]
    charged: Array

    @property
    def model(self) -> Model:
        """The model that was fitted."""
        return self.estimate.model

    def losses(self, scale: float) -> Array:
        """Predictive loss of each run at a dispersion [nats]."""
        return self.charged + [float(robust.bounded_loss(r / scale).sum()) for r in self.left_out]


def folds(runs: Sequence[Run], most: int = CROSS_VALIDATION.most) -> list[list[int]]:
    """Run numbers by fold: whole conditions, dealt in turn; single runs where all are alike."""
    conditions = list(dict.fromkeys(run.condition for run in runs))
    label = [conditions.index(run.condition) for run in runs]
    if len(conditions) == 1:
        label = list(range(len(runs)))
    count = min(most, max(label) + 1)
    return [[i for i, c in enumerate(label) if c % count == f] for f in range(count)]


def validate(estimate: Estimate) -> Task[Validated]:
    """Predictive residuals of every run; yields simulations."""
    dealt = folds(estimate.evidence.runs)
    parts = yield from side_by_side([_fold(estimate, fold) for fold in dealt])
    left_out: dict[int, Array] = {}
    charged = np.zeros(len(estimate.evidence.runs))
    for fold, (found, unknown, unlikely) in zip(dealt, parts, strict=True):
        left_out.update(zip(fold, found, strict=True))
        charged[fold] += unlikely
        charged[fold[0]] += unknown
    return Validated(estimate, tuple(left_out[i] for i in range(len(charged))), charged)


def _fold(estimate: Estimate, fold: Sequence[int]) -> Task[tuple[tuple[Array, ...], int, Array]]:
    """Whitened residuals of the runs of `fold` under the fit to all others, how many shared
    unknowns only these runs determine, and how unlikely their random unknowns are [nats].
    """
    keep = [i for i in range(len(estimate.evidence.runs)) if i not in fold] or list(fold)
    shared, only = on_runs(estimate, keep)
    unseen = estimate.on(fold).evidence
    own = Point(np.zeros(0), tuple(_own_unknowns(estimate, i, shared) for i in fold))
    raw = yield requests(estimate.model.holding(shared), unseen.runs, own)
    unlikely = [_unlikely(r, v) for r, v in zip(unseen.runs, own.local, strict=True)]
    return residuals(raw, unseen), int(only.sum()), np.array(unlikely)


def on_runs(estimate: Estimate, keep: Sequence[int]) -> tuple[Array, normal_equations.Mask]:
    """Shared values (P,) of the fit to the runs `keep` alone, one Newton step from the whole one,
    and which of them (P,) keep their value because those runs say next to nothing of them.
    """
    only = _only_here(estimate, keep)
    return _newton(estimate.on(keep), only), only


def _unlikely(run: Run, local: Array) -> float:
    """Minus log density of a run's random unknowns, up to what is the same in all models."""
    pairs = zip(run.local, local, strict=True)
    return 0.5 * sum(((float(v) - p.start) / p.spread) ** 2 for p, v in pairs if p.random)


def _only_here(estimate: Estimate, keep: Sequence[int]) -> normal_equations.Mask:
    """Which shared unknowns (P,) of effects the runs `keep` say next to nothing of.

    An effect that lives in one condition cannot be predicted from the others; it keeps its
    value, and is charged with the nat by which a fit flatters itself (Akaike 1974).
    """
    count = len(estimate.shared)
    base = len(estimate.model.base)
    with_all, without = (
        np.diag(normal_equations.covariance(some.normal().curvature))[:count]
        for some in (estimate, estimate.on(keep))
    )
    return np.asarray((without > CROSS_VALIDATION.silent * with_all) & (np.arange(count) >= base))


def _newton(some: Estimate, held: normal_equations.Mask) -> Array:
    """Shared values (P,) one bounded Newton step from `some` runs at the whole fit; `held` (P,)
    stay.
    """
    limits, z = some.limits, some.z
    fixed = np.concatenate([held, np.zeros(len(z) - len(held), dtype=bool)])
    limits = replace(
        limits, low=np.where(fixed, z, limits.low), high=np.where(fixed, z, limits.high)
    )
    return (z + normal_equations.bounded_step(some.normal(), z, limits))[: len(held)]


def _own_unknowns(estimate: Estimate, i: int, shared: Array) -> Array:
    """The run's own unknowns, moved linearly with the shared values."""
    count = len(estimate.shared)
    jacobian, own = estimate.jacobians[i], estimate.jacobians[i][:, count:]
    moved = jacobian[:, :count] @ (shared - estimate.shared)
    weight = robust.weights(estimate.residuals[i] / estimate.scale)[:, None]
    spread = np.array([p.spread for p in estimate.evidence.runs[i].local])
    curvature = (own * weight).T @ own / estimate.scale**2 + np.diag(spread**-2)
    gradient = (own * weight).T @ moved / estimate.scale**2
    return np.asarray(estimate.point.local[i] - np.linalg.solve(curvature, gradient))
