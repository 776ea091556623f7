"""Cross-validation: how well a fitted model predicts conditions that it was not fitted
to.

Each fold leaves out whole conditions; frames of one run are never split. The fit
without a fold is taken to be one Newton step from the fit with it (Giordano et al.
2019, A Swiss Army infinitesimal jackknife). The runs left out then adapt their own
unknowns.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Self

import numpy as np

from cell.gap.fitting import Task, robust, side_by_side
from cell.gap.fitting.gauss_newton import FitEstimate, residuals
from cell.gap.fitting.model import Point, requests
from cell.gap.fitting.normal_equations import Mask, covariance
from cell.gap.subject.subject import FitRun
from drivers.base.types import Array

REWEIGHTED = 3  # times that robust weights are renewed; set by hand
MOST_FOLDS = 8  # set by hand
SILENT = 10.0
"""Times its variance under all runs, beyond which that under some of them says that
they do not determine a value: they hold a tenth of the information. Set by hand.
"""


class NormalDensity(NamedTuple):
    """Multivariate normal density of k amounts: their `mean` (k,) and `precision` (k,
    k).
    """

    mean: Array
    precision: Array

    def condition(self, r: Array, responses: Array) -> tuple[Self, float]:
        """Posterior density of the amounts given the residuals `r` (n,) of a run, and
        the negative log density [nats] of these residuals.

        Residuals change by `responses` (n, k) with the amounts. Both are by Laplace's
        approximation under the robust loss; the loss leaves out the constant of unit
        noise.
        """
        before, precision = self
        mean = before
        curvature = precision

        for _ in range(REWEIGHTED):
            weighed = responses.T * robust.weights(r + responses @ mean)
            curvature = weighed @ responses + precision
            pull = precision @ before - weighed @ r
            mean = np.asarray(np.linalg.solve(curvature, pull))

        moved = mean - before
        loss = robust.bounded_loss(r + responses @ mean).sum()
        loss += 0.5 * (moved @ precision @ moved)
        now, then = (np.linalg.slogdet(each)[1] for each in (curvature, precision))
        return type(self)(mean, curvature), loss + 0.5 * (now - then)


@dataclass(frozen=True, slots=True)
class CrossValidatedFit(FitEstimate):
    """Fitted model with the whitened residuals (n,) of each run, predicted without the
    runs of its fold.

    `uncertain` (n, k) by run are its responses to one standard deviation of the shared
    values under the other folds. `charged` (R,) [nats] is added to the loss of each
    run: for values that only this run determines, and for how unlikely its own random
    unknowns are.
    """

    left_out: Sequence[Array]
    uncertain: Sequence[Array]
    charged: Array

    def losses(self, scale: float) -> Array:
        """Negative log predictive density (runs,) [nats] of each run, at the residuals'
        dispersion `scale`.

        That of a run given the other folds, with the shared values as uncertain as
        those leave them (Laplace's approximation); runs of one fold follow one another.
        """
        losses = self.charged.copy()
        for fold in folds(self.runs):
            size = self.uncertain[fold[0]].shape[1]
            values = NormalDensity(np.zeros(size), np.eye(size))
            for i in fold:
                values, loss = values.condition(
                    self.left_out[i] / scale, self.uncertain[i] / scale
                )
                losses[i] += loss
        return losses


def folds(runs: Sequence[FitRun], most: int = MOST_FOLDS) -> list[list[int]]:
    """Numbers of the runs in each cross-validation fold: runs of one condition share a
    fold.

    Conditions are dealt in turn; where all runs share one condition, single runs are.
    """
    conditions = list(dict.fromkeys(run.condition for run in runs))
    label = [conditions.index(run.condition) for run in runs]
    if len(conditions) == 1:
        label = list(range(len(runs)))
    count = min(most, max(label) + 1)
    return [[i for i, c in enumerate(label) if c % count == f] for f in range(count)]


Prediction = tuple[Array, Array, float]
"""Of a run left out: residuals (n,), uncertain part (n, k) of them, penalty [nats]."""


def validate(estimate: FitEstimate) -> Task[CrossValidatedFit]:
    """Cross-validate `estimate`: predict each run from a fit to the other folds; a task
    that yields simulation requests.
    """
    dealt = folds(estimate.runs)
    parts = yield from side_by_side([_predict_fold(estimate, fold) for fold in dealt])
    by_run = {
        i: run
        for fold, part in zip(dealt, parts, strict=True)
        for i, run in zip(fold, part, strict=True)
    }
    predictions = (by_run[i] for i in sorted(by_run))
    left_out, uncertain, penalty = zip(*predictions, strict=True)
    fitted = {each.name: getattr(estimate, each.name) for each in fields(FitEstimate)}
    return CrossValidatedFit(
        **fitted,
        left_out=left_out,
        uncertain=uncertain,
        charged=np.array(penalty),
    )


def _predict_fold(estimate: FitEstimate, fold: Sequence[int]) -> Task[list[Prediction]]:
    """Predict the runs of `fold` from a fit to all other runs; a task that yields
    simulation requests.

    Penalised by the number of shared values that only the fold determines, at its first
    run, and by the losses of the runs' random unknowns.
    """
    keep = [i for i in range(len(estimate.runs)) if i not in fold] or list(fold)
    shared, undetermined = on_runs(estimate, keep)
    unseen = estimate.on(fold).runs
    moved = shared - estimate.shared
    local = estimate.local
    own = Point(
        np.zeros(0), [local[i] + _own_response(estimate, i) @ moved for i in fold]
    )
    raw = yield requests(estimate.model.holding(shared), unseen, own)
    penalty = np.array([*map(_random_loss, unseen, own.local)])
    penalty[0] += undetermined.sum()
    deviations = _deviations(estimate.on(keep), shared, undetermined)
    uncertain = [settled_response(estimate, i) @ deviations for i in fold]
    return [*zip(residuals(raw, unseen), uncertain, penalty, strict=True)]


def on_runs(estimate: FitEstimate, keep: Sequence[int]) -> tuple[Array, Mask]:
    """Shared values (P,) fitted to the runs numbered `keep` only, and a mask (P,) of
    those that these runs do not determine.

    One Newton step from the fit to all runs; a value stays where the runs do not
    determine it.
    """
    undetermined = _undetermined_values(estimate, keep)
    return _newton_step(estimate.on(keep), undetermined), undetermined


def _random_loss(run: FitRun, local: Array) -> float:
    """Negative log prior density [nats] of a run's random unknowns (k,), up to a
    constant.
    """
    pairs = zip(run.local, local, strict=True)
    return 0.5 * sum(
        ((float(v) - p.start) / p.spread) ** 2 for p, v in pairs if p.random
    )


def _undetermined_values(estimate: FitEstimate, keep: Sequence[int]) -> Mask:
    """Mask (P,) of the effects' parameters that the runs numbered `keep` do not
    determine.

    An effect that lives in one condition cannot be predicted from the others; it keeps
    its value, and is charged with the nat by which a fit flatters itself (Akaike 1974).
    """
    count = len(estimate.shared)
    base = len(estimate.model.base)
    of_all, of_kept = (
        np.diag(covariance(e.normal().curvature))[:count]
        for e in (estimate, estimate.on(keep))
    )
    return (of_kept > SILENT * of_all) & (np.arange(count) >= base)


def _newton_step(estimate: FitEstimate, held: Mask) -> Array:
    """Shared values (P,) after one Newton step of `estimate` within bounds; those in
    the mask `held` (P,) stay fixed.
    """
    unknowns = estimate.unknowns
    z = estimate.z
    count = len(held)
    fixed = np.pad(held, (0, len(z) - count))
    low, high = (
        np.where(fixed, 0.0, bound - z) for bound in (unknowns.low, unknowns.high)
    )
    return (z + estimate.normal().bounded_step(low, high))[:count]


def _deviations(kept: FitEstimate, shared: Array, undetermined: Mask) -> Array:
    """Directions (P, k) in which the P shared values are uncertain, given the runs
    `kept`, each of one standard deviation.

    Values that are `undetermined` (P,), or of `shared` (P,) those on a bound, are taken
    as known.
    """
    unknowns = kept.unknowns
    size = len(shared)
    low, high = (bound[:size] for bound in (unknowns.low, unknowns.high))
    free = (shared > low) & (shared < high) & ~undetermined
    every = np.pad(free, (0, len(kept.z) - size), constant_values=True)
    curvature = kept.normal().curvature[np.ix_(every, every)]
    count = free.sum()
    of_shared = covariance(curvature)[:count, :count]
    deviations = np.zeros((size, count))
    variances, axes = np.linalg.eigh(of_shared)
    deviations[free] = axes * np.sqrt(np.maximum(variances, 0.0))
    return deviations


def _own_response(estimate: FitEstimate, i: int) -> Array:
    """Derivative (k, P) of the refitted k unknowns of run number `i` by the P shared
    values.
    """
    count = len(estimate.shared)
    scale = estimate.scale
    jacobian = estimate.jacobians[i]
    shared, own = np.split(jacobian, [count], axis=1)
    weighed = own.T * (robust.weights(estimate.residuals[i] / scale) / scale**2)
    spread = np.array([p.spread for p in estimate.runs[i].local])
    least = np.finfo(float).tiny  # of a run that diverges where its own unknowns change
    curvature = weighed @ own + np.diag(spread**-2 + least)
    return np.asarray(np.linalg.solve(curvature, -weighed @ shared))


def settled_response(estimate: FitEstimate, i: int) -> Array:
    """Derivative (n, P) of the residuals of run number `i` by the P shared values, with
    the run's own unknowns refitted.
    """
    shared, own = np.split(estimate.jacobians[i], [len(estimate.shared)], axis=1)
    return shared + own @ _own_response(estimate, i)
