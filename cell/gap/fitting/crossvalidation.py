"""Cross-validation: how well a fitted model predicts conditions that it was not fitted to.

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
    """Settings of cross-validation: the number of folds, and when runs do not determine a value.

    At most `most` folds. Runs do not determine a value whose variance under them alone is over
    `silent` times that under all runs: they hold a tenth of the information. Source: set by hand.
    """

    most: int = 8
    silent: float = 10.0


CROSS_VALIDATION = CrossValidation()


@dataclass(frozen=True, slots=True)
class Validated:
    """A fitted model with its cross-validation: whitened residuals (n,) of each run left out.

    `charged` (R,) [nats] is added to the loss of each run: for values that only this run
    determines, and for how unlikely its own random unknowns are.
    """

    estimate: Estimate
    left_out: tuple[Array, ...]
    charged: Array

    @property
    def model(self) -> Model:
        """The model that was fitted."""
        return self.estimate.model

    def losses(self, scale: float) -> Array:
        """Predictive loss (R,) [nats] of each run at the dispersion `scale`."""
        return self.charged + [float(robust.bounded_loss(r / scale).sum()) for r in self.left_out]


def folds(runs: Sequence[Run], most: int = CROSS_VALIDATION.most) -> list[list[int]]:
    """Run numbers by fold: conditions are dealt in turn, single runs where all share one."""
    conditions = list(dict.fromkeys(run.condition for run in runs))
    label = [conditions.index(run.condition) for run in runs]
    if len(conditions) == 1:
        label = list(range(len(runs)))
    count = min(most, max(label) + 1)
    return [[i for i, c in enumerate(label) if c % count == f] for f in range(count)]


def validate(estimate: Estimate) -> Task[Validated]:
    """Predict every run of `estimate` from the fit to the other folds; yields simulations."""
    dealt = folds(estimate.evidence.runs)
    parts = yield from side_by_side([_predict_fold(estimate, fold) for fold in dealt])
    left_out: dict[int, Array] = {}
    charged = np.zeros(len(estimate.evidence.runs))
    for fold, (predicted, undetermined, random_losses) in zip(dealt, parts, strict=True):
        left_out.update(zip(fold, predicted, strict=True))
        charged[fold] += random_losses
        charged[fold[0]] += undetermined
    return Validated(estimate, tuple(left_out[i] for i in range(len(charged))), charged)


def _predict_fold(
    estimate: Estimate, fold: Sequence[int]
) -> Task[tuple[tuple[Array, ...], int, Array]]:
    """Whitened residuals of the runs of `fold` under the fit to all others, and two penalties.

    These are the number of shared values that only the fold determines, and the loss (R,) [nats]
    of the runs' random unknowns.
    """
    keep = [i for i in range(len(estimate.evidence.runs)) if i not in fold] or list(fold)
    shared, undetermined = on_runs(estimate, keep)
    unseen = estimate.on(fold).evidence
    own = Point(np.zeros(0), tuple(_own_unknowns(estimate, i, shared) for i in fold))
    raw = yield requests(estimate.model.holding(shared), unseen.runs, own)
    losses = [_random_loss(r, v) for r, v in zip(unseen.runs, own.local, strict=True)]
    return residuals(raw, unseen), int(undetermined.sum()), np.array(losses)


def on_runs(estimate: Estimate, keep: Sequence[int]) -> tuple[Array, normal_equations.Mask]:
    """Shared values (P,) fitted to the runs `keep` alone, and a mask (P,) of unchanged ones.

    One Newton step from the fit to all runs; a value stays where the runs do not determine it.
    """
    undetermined = _undetermined_values(estimate, keep)
    return _newton_step(estimate.on(keep), undetermined), undetermined


def _random_loss(run: Run, local: Array) -> float:
    """Minus log prior density [nats] of a run's random unknowns, up to a constant."""
    pairs = zip(run.local, local, strict=True)
    return 0.5 * sum(((float(v) - p.start) / p.spread) ** 2 for p, v in pairs if p.random)


def _undetermined_values(estimate: Estimate, keep: Sequence[int]) -> normal_equations.Mask:
    """Mask (P,) of the parameters of effects that the runs `keep` do not determine.

    An effect that lives in one condition cannot be predicted from the others; it keeps its
    value, and is charged with the nat by which a fit flatters itself (Akaike 1974).
    """
    count = len(estimate.shared)
    base = len(estimate.model.base)
    of_all, of_kept = (
        np.diag(normal_equations.covariance(e.normal().curvature))[:count]
        for e in (estimate, estimate.on(keep))
    )
    return np.asarray((of_kept > CROSS_VALIDATION.silent * of_all) & (np.arange(count) >= base))


def _newton_step(estimate: Estimate, held: normal_equations.Mask) -> Array:
    """Shared values (P,) after a bounded Newton step of `estimate`; the `held` ones (P,) stay."""
    limits, z = estimate.limits, estimate.z
    fixed = np.concatenate([held, np.zeros(len(z) - len(held), dtype=bool)])
    limits = replace(
        limits, low=np.where(fixed, z, limits.low), high=np.where(fixed, z, limits.high)
    )
    return (z + normal_equations.bounded_step(estimate.normal(), z, limits))[: len(held)]


def _own_unknowns(estimate: Estimate, i: int, shared: Array) -> Array:
    """Own unknowns (k,) of run number `i`, refitted linearly to the new `shared` values (P,)."""
    count = len(estimate.shared)
    jacobian, own = estimate.jacobians[i], estimate.jacobians[i][:, count:]
    change = jacobian[:, :count] @ (shared - estimate.shared)
    weight = robust.weights(estimate.residuals[i] / estimate.scale)[:, None]
    spread = np.array([p.spread for p in estimate.evidence.runs[i].local])
    curvature = (own * weight).T @ own / estimate.scale**2 + np.diag(spread**-2)
    gradient = (own * weight).T @ change / estimate.scale**2
    return np.asarray(estimate.point.local[i] - np.linalg.solve(curvature, gradient))
