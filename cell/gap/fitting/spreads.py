"""How much quantities differ from run to run, estimated from the runs themselves.

Unknowns of a run that are `random` are drawn anew in each run, with mean zero and a spread that
all runs share. Spreads maximise the marginal likelihood of the linearised model, with all other
unknowns integrated out (Patterson and Thompson 1971, restricted maximum likelihood; Pinheiro and
Bates 2000, Mixed-effects models in S and S-PLUS, section 2.2). The common part of such a
quantity counts as an unknown of its own: a constant error of the rig is no scatter.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import optimize

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.projection import stacked
from cell.gap.subject.subject import Parameter
from drivers.types import Array

WORTH = 3.0  # nats that a quantity must gain to count as scattered
TIE = 2.0  # nats by which a quantity must beat those that scatter more commonly, named first
SMALLEST, LARGEST = 0.03, 5.0  # of the usual spread, between which one is sought
LEAST = 0.1  # of the stated variance, of what any fit leaves
GRID = np.geomspace(SMALLEST, LARGEST, 41)  # shares of the usual spread, to be averaged over
NOTHING = np.zeros(0)
REFUTED = 1 / 3  # Bayes factor below which a common quantity does not scatter here
COMMON = 10.0  # times its usual spread, that the common part of a quantity may have


@dataclass(frozen=True, slots=True)
class Spread:
    """A quantity that differs from run to run: its standard deviation and 95 % interval.

    `gain` [nats] is what the marginal likelihood loses without it.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    gain: float

    @property
    def error(self) -> float:
        """Standard error of the logarithm of the spread."""
        return float(np.log(self.high / self.low)) / (2.0 * 1.96)


@dataclass(frozen=True, slots=True)
class _Marginal:
    """The quadratic model of a fit about zero scatter.

    `curvature` (u, u) and `pull` (u,) of data and priors of all unknowns but the random ones'
    own; `owner` (u,) numbers the random quantity of an unknown, -1 where it is none.
    """

    curvature: Array
    pull: Array
    owner: Array
    usual: Array

    def loss(self, shares: Array, active: Sequence[int]) -> float:
        """Minus log marginal likelihood [nats] at spreads `shares` (k,) of the usual ones.

        A half-normal prior of unit width on each share stands in where runs are few.
        """
        spread = np.zeros(len(self.usual))
        spread[list(active)] = shares * self.usual[list(active)]
        kept = (self.owner < 0) | (spread[self.owner] > 0.0)
        random = kept & (self.owner >= 0)
        precision = np.zeros(len(self.owner))
        precision[random] = spread[self.owner[random]] ** -2
        whole = (self.curvature + np.diag(precision))[np.ix_(kept, kept)]
        pull = self.pull[kept]
        d = 1.0 / np.sqrt(np.diag(whole))
        lower = np.linalg.cholesky(whole * d[:, None] * d[None] + 1e-10 * np.eye(len(d)))
        solved = np.linalg.solve(lower, d * pull)
        half_logdet = float(np.log(np.diag(lower)).sum() - np.log(d).sum())
        own = 0.5 * float(np.log(precision[random]).sum())
        return half_logdet - own - 0.5 * float(solved @ solved) + 0.5 * float(shares @ shares)


def spreads(estimate: Estimate) -> tuple[Spread, ...]:
    """The quantities that differ from run to run in `estimate`, the common ones first.

    Common ones scatter in every laboratory: they stay unless the runs refute them. Others are
    taken in one by one while each gains WORTH nats beside those, since a slack that differs looks
    much like a grip that does.
    """
    known = _random(estimate)
    if not known or len(estimate.evidence.runs) < 2:
        return ()
    model, parameters = _marginal(estimate, known), list(known.values())
    found = _Chosen.of(model, [k for k, p in enumerate(parameters) if p.common])
    found = _unrefuted(_with_others(found, len(known)), parameters)
    shares = _averaged(found)
    gains = [found.without(i) - found.loss for i in range(len(shares))]
    errors = _errors(model, found.active, shares)
    rows = zip([parameters[k] for k in found.active], shares, errors, gains, strict=True)
    return tuple(
        Spread(p.name, p.unit, s * p.spread, s * p.spread * float(np.exp(-1.96 * e)),
               s * p.spread * float(np.exp(1.96 * e)), g)
        for p, s, e, g in rows
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Chosen:
    """Quantities `active` that scatter by `shares` (k,) of the usual, at a `loss` [nats]."""

    model: _Marginal
    active: tuple[int, ...]
    shares: Array
    loss: float

    @classmethod
    def of(cls, model: _Marginal, active: Sequence[int], start: Array = NOTHING) -> Self:
        """Their most likely shares, sought from `start` for the first of them."""
        loss, shares = _fitted(model, active, start)
        return cls(model, tuple(active), shares, loss)

    def without(self, i: int) -> float:
        """Loss [nats] without the quantity in place `i`, the others sought anew."""
        others = [k for j, k in enumerate(self.active) if j != i]
        return _fitted(self.model, others, np.delete(self.shares, i))[0]


def _with_others(found: _Chosen, known: int) -> _Chosen:
    """`found` with those of all `known` quantities that gain WORTH nats, in their order where two
    gain about as much.
    """
    while len(found.active) < known:
        trials = [
            _Chosen.of(found.model, [*found.active, k], found.shares)
            for k in range(known) if k not in found.active
        ]  # fmt: skip
        lowest = min(trial.loss for trial in trials)
        best = next(trial for trial in trials if trial.loss < lowest + TIE)
        if found.loss - best.loss < WORTH:
            break
        found = best
    return found


def _unrefuted(found: _Chosen, parameters: Sequence[Parameter]) -> _Chosen:
    """`found` without the common quantities that the runs speak against.

    The spread of such a one, averaged over what laboratories have, explains the runs worse by a
    factor of REFUTED than none (Bayes factor: Kass and Raftery 1995).
    """
    kept = [
        k for i, k in enumerate(found.active)
        if not parameters[k].common or _bayes_factor(found, i) > REFUTED
    ]  # fmt: skip
    return found if len(kept) == len(found.active) else _Chosen.of(found.model, kept)


def _bayes_factor(found: _Chosen, i: int) -> float:
    """By how much likelier the runs are with a spread in place `i` than without."""
    others = [k for j, k in enumerate(found.active) if j != i]
    none = found.model.loss(np.delete(found.shares, i), others)
    likelihood = np.exp(np.clip(none + 0.5 * GRID**2 - _losses(found, i), -50.0, 50.0))
    prior = GRID * np.exp(-0.5 * GRID**2)  # even steps of the logarithm
    return float(prior @ likelihood / prior.sum())


def _averaged(found: _Chosen) -> Array:
    """Mean of each share given the runs, the others at their most likely values.

    Of few runs the likelihood of a spread has a long tail to the large ones, so that its peak is
    too small in most laboratories.
    """
    means = np.zeros(len(found.active))
    for i in range(len(means)):
        losses = _losses(found, i)
        likely = GRID * np.exp(losses.min() - losses)
        means[i] = float(likely @ GRID / likely.sum())
    return means


def _losses(found: _Chosen, i: int) -> Array:
    """Losses [nats] over GRID of the share in place `i`."""
    return np.array([found.model.loss(_put(found.shares, i, s), found.active) for s in GRID])


def _put(values: Array, i: int, value: float) -> Array:
    changed = values.copy()
    changed[i] = value
    return changed


def _random(estimate: Estimate) -> dict[str, Parameter]:
    """Random unknowns by name."""
    return {p.name: p for run in estimate.evidence.runs for p in run.local if p.random}


def _marginal(estimate: Estimate, known: dict[str, Parameter]) -> _Marginal:
    r = np.concatenate(estimate.residuals)
    worth = max(LEAST, robust.long_run_variance(estimate.evidence.runs, estimate.residuals))
    weight = np.sqrt(robust.weights(r / estimate.scale) / worth) / estimate.scale
    columns = stacked(estimate)
    place = normal_equations.layout(estimate.model, estimate.evidence)
    z = place.packed(estimate.point)
    every = [*estimate.model.parameters, *(p for run in estimate.evidence.runs for p in run.local)]
    order = list(known)
    owner = np.array([order.index(p.name) if p.random else -1 for p in every])
    prior = np.array([0.0 if p.random else p.spread**-2 for p in every])
    start = np.array([p.start for p in every])
    target = r - columns @ np.where(owner >= 0, z, 0.0)
    pull = prior * (z - start)
    common = np.stack([columns[:, owner == k].sum(axis=1) for k in range(len(order))], axis=1)
    usual = np.array([known[name].spread for name in order])
    more = (COMMON * usual) ** -2
    whole = np.concatenate([columns, common], axis=1) * weight[:, None]
    curvature = whole.T @ whole + np.diag(np.concatenate([prior, more]))
    curvature += np.diag(1e-9 * np.diag(curvature) + 1e-12)
    added = np.zeros(len(more))
    return _Marginal(
        curvature,
        -(whole.T @ (target * weight) + np.concatenate([pull, added])),
        np.concatenate([owner, np.full(len(more), -1)]),
        usual,
    )


def _fitted(model: _Marginal, active: Sequence[int], start: Array) -> tuple[float, Array]:
    """Least loss over the spreads of `active` quantities, and their shares of the usual ones."""
    if not len(active):
        return model.loss(np.zeros(0), []), np.zeros(0)
    begin = np.log(np.concatenate([start, np.full(len(active) - len(start), 0.5)]))
    limits = [(np.log(SMALLEST), np.log(LARGEST))] * len(active)
    found = optimize.minimize(
        lambda x: model.loss(np.exp(x), active), begin, method="L-BFGS-B", bounds=limits
    )
    return float(found.fun), np.exp(found.x)


def _errors(model: _Marginal, active: Sequence[int], shares: Array) -> Array:
    """Standard errors (k,) of the logarithms of the shares, from the curvature of the loss."""
    if not len(active):
        return np.zeros(0)
    x, h, k = np.log(shares), 0.1, len(shares)
    here = model.loss(shares, active)
    hessian = np.zeros((k, k))
    for i in range(k):
        step = h * np.eye(k)[i]
        ends = [model.loss(np.exp(x + s * step), active) for s in (-1.0, 1.0)]
        hessian[i, i] = max((sum(ends) - 2.0 * here) / h**2, 0.1)
    return np.asarray(1.0 / np.sqrt(np.diag(hessian)))
