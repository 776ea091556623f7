"""How much quantities differ from run to run, estimated from the runs themselves.

Unknowns of a run that are `random` are drawn anew in each run, with mean zero and a spread that
all runs share. Spreads maximise the marginal likelihood of the linearised model, with all other
unknowns integrated out (Patterson and Thompson 1971, restricted maximum likelihood; Pinheiro and
Bates 2000, Mixed-effects models in S and S-PLUS, section 2.2). The common part of such a
quantity counts as an unknown of its own: a constant error of the rig is no scatter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

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
GRID = np.linspace(0.05, 2.5, 15)  # shares of the usual spread over which it is averaged
AROUND = np.exp(np.linspace(-2.0, 2.0, 17))  # times a likely spread, over which it is averaged
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
    """The quantities that differ from run to run in `estimate`, largest gain first.

    Quantities are taken in one by one while each gains WORTH nats; those that the runs do not
    show are left out, unless they are common and the runs do not refute them.
    """
    known = _random(estimate)
    if not known or len(estimate.evidence.runs) < 2:
        return ()
    model = _marginal(estimate, known)
    active: list[int] = []
    shares, least = np.zeros(0), model.loss(np.zeros(0), [])
    gains: list[float] = []
    while len(active) < len(known):
        trials = [
            (*_fitted(model, [*active, k], shares), k)
            for k in range(len(known)) if k not in active
        ]  # fmt: skip
        lowest = min(value for value, _, _ in trials)
        value, found, k = next(trial for trial in trials if trial[0] < lowest + TIE)
        if least - value < WORTH:
            break
        active, shares, least = [*active, k], found, value
    for i in range(len(active)):
        others = [k for j, k in enumerate(active) if j != i]
        value, _ = _fitted(model, others, np.delete(shares, i))
        gains.append(value - least)
    shares = _averaged(model, active, shares)
    active, shares, gains = _kept(model, list(known.values()), active, shares, gains)
    errors = _errors(model, active, shares)
    names = list(known.values())
    return tuple(
        Spread(p.name, p.unit, s * p.spread, s * p.spread * float(np.exp(-1.96 * e)),
               s * p.spread * float(np.exp(1.96 * e)), g)
        for p, s, e, g in zip([names[k] for k in active], shares, errors, gains, strict=True)
    )  # fmt: skip


def _averaged(model: _Marginal, active: Sequence[int], shares: Array) -> Array:
    """Mean of each share given the runs, the others at their most likely values.

    Of few runs the likelihood of a spread has a long tail to the large ones, so that its peak is
    too small in most laboratories.
    """
    means = shares.copy()
    for i, share in enumerate(shares):
        tried = share * AROUND
        losses = np.array([model.loss(_put(shares, i, s), active) for s in tried])
        likely = tried * np.exp(losses.min() - losses)  # even steps of the logarithm
        means[i] = float(likely @ tried / likely.sum())
    return means


def _put(values: Array, i: int, value: float) -> Array:
    changed = values.copy()
    changed[i] = value
    return changed


def _kept(
    model: _Marginal,
    known: Sequence[Parameter],
    active: list[int],
    shares: Array,
    gains: list[float],
) -> tuple[list[int], Array, list[float]]:
    """The quantities that the runs show, and the common ones that they do not refute.

    A common quantity is refuted where its spread, averaged over what laboratories have, explains
    the runs worse by a factor of REFUTED than none (Bayes factor: Kass and Raftery 1995). Kept,
    it has its mean spread given the runs.
    """
    weights = np.exp(-0.5 * GRID**2)
    weights /= weights.sum()
    for k, p in enumerate(known):
        if not p.common or k in active:
            continue
        none = model.loss(shares, active)
        own = [model.loss(np.append(shares, s), [*active, k]) - 0.5 * s * s for s in GRID]
        likely = weights * np.exp(np.clip(none - np.array(own), -50.0, 50.0))
        factor = float(likely.sum())
        if factor > REFUTED:
            active = [*active, k]
            shares = np.append(shares, float(likely @ GRID) / factor)
            gains = [*gains, float(np.log(factor))]
    return active, shares, gains


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
