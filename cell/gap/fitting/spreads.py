"""Estimates how much quantities differ from run to run, from the runs themselves.

Unknowns of a run that are `random` are drawn anew in each run, with mean zero and a spread that
all runs share. Spreads maximise the marginal likelihood of the linearised model, with all other
unknowns integrated out (Patterson and Thompson 1971, restricted maximum likelihood; Pinheiro and
Bates 2000, Mixed-effects models in S and S-PLUS, section 2.2).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.marginal import SOUGHT, Marginal
from cell.gap.subject.subject import Parameter
from drivers.types import Array

# shares of the usual spread, averaged over
SPREAD_GRID = np.geomspace(SOUGHT.smallest, SOUGHT.largest, 41)
NO_START = np.zeros(0)
CENTRAL_95 = 1.96  # standard deviations of a normal, within which 95 % lie
LOG_STEP = 0.1  # of the logarithm of a share, for the curvature of the loss; set by hand
LEAST_CURVATURE = 0.1  # of the loss, where runs hardly bound a spread; set by hand


@dataclass(frozen=True, slots=True)
class Believed:
    """What is believed of quantities that may differ from run to run, before any run is seen.

    A common one does so with probability `common`. Another must gain `worth` nats, and beat those
    that scatter more commonly, named first, by `tie`. Source: set by hand; `python -m
    tests.lab study spreads` tests it on true spreads.
    """

    common: float = 0.9
    worth: float = 3.0
    tie: float = 2.0


BELIEVED = Believed()


@dataclass(frozen=True, slots=True)
class Spread:
    """A quantity that differs from run to run: its standard deviation and 95 % interval."""

    name: str
    unit: str
    value: float
    low: float
    high: float

    @property
    def error(self) -> float:
        """Standard error of the logarithm of the spread."""
        return float(np.log(self.high / self.low)) / (2.0 * CENTRAL_95)


def spreads(estimate: Estimate) -> tuple[Spread, ...]:
    """Spreads of the quantities that differ from run to run in `estimate`, common ones first.

    Common ones scatter in most laboratories: each has its posterior mean, in which no scatter
    counts too, and is left out where that is below `SOUGHT.smallest`. Others are taken in one by
    one while each gains enough beside those: a slack that differs looks like a grip that does.
    """
    known = _random_unknowns(estimate)
    if not known or len(estimate.evidence.runs) < 2:
        return ()
    model, parameters = Marginal.of(estimate, known), list(known.values())
    found = _Chosen.of(model, [k for k, p in enumerate(parameters) if p.common])
    found = _with_others(found, len(known))
    chosen = [parameters[k] for k in found.active]
    shares = np.array([_mean_share(found, i, p.common) for i, p in enumerate(chosen)])
    errors = _errors(model, found.active, np.maximum(shares, SOUGHT.smallest))
    rows = zip(chosen, shares, errors, strict=True)
    return tuple(_spread(p, s, error) for p, s, error in rows if s >= SOUGHT.smallest)


def _spread(p: Parameter, share: float, error: float) -> Spread:
    """Spread and interval of `p` from its `share` of the usual and the `error` of its logarithm."""
    low, high = float(np.exp(-CENTRAL_95 * error)), float(np.exp(CENTRAL_95 * error))
    value = share * p.spread
    return Spread(p.name, p.unit, value, value * low, value * high)


@dataclass(frozen=True, slots=True)
class _Chosen:
    """Quantities `active` that scatter, their `shares` (k,) of the usual, and the `loss` [nats]."""

    model: Marginal
    active: tuple[int, ...]
    shares: Array
    loss: float

    @classmethod
    def of(cls, model: Marginal, active: Sequence[int], start: Array = NO_START) -> Self:
        """Fit the shares of the quantities `active`, from `start` (j,) for the first of them."""
        loss, shares = model.least(active, start)
        return cls(model, tuple(active), shares, loss)


def _with_others(found: _Chosen, count: int) -> _Chosen:
    """Add to `found` each of `count` quantities that gains enough; of near equals the first."""
    while len(found.active) < count:
        trials = [
            _Chosen.of(found.model, [*found.active, k], found.shares)
            for k in range(count) if k not in found.active
        ]  # fmt: skip
        lowest = min(trial.loss for trial in trials)
        best = next(trial for trial in trials if trial.loss < lowest + BELIEVED.tie)
        if found.loss - best.loss < BELIEVED.worth:
            break
        found = best
    return found


def _mean_share(found: _Chosen, i: int, common: bool) -> float:
    """Posterior mean of the share of active quantity `i`, with the others at their most likely.

    Of few runs the likelihood of a spread has a long tail to the large ones, so its peak is too
    small in most laboratories. For a `common` quantity the mean also counts the possibility
    that it does not differ at all.
    """
    losses = _losses(found, i)
    likely = SPREAD_GRID * np.exp(losses.min() - losses)
    mean = float(likely @ SPREAD_GRID / likely.sum())
    return mean * _probability(found, i, losses) if common else mean


def _probability(found: _Chosen, i: int, losses: Array) -> float:
    """Posterior probability that common quantity `i` differs, by its `losses` (41,) on the grid."""
    odds = BELIEVED.common / (1.0 - BELIEVED.common) * _bayes_factor(found, i, losses)
    return odds / (1.0 + odds)


def _bayes_factor(found: _Chosen, i: int, losses: Array) -> float:
    """Bayes factor of the runs for a spread of active quantity number `i` against none."""
    others = [k for j, k in enumerate(found.active) if j != i]
    none = found.model.loss(np.delete(found.shares, i), others)
    likelihood = np.exp(np.clip(none + 0.5 * SPREAD_GRID**2 - losses, -50.0, 50.0))
    prior = SPREAD_GRID * np.exp(-0.5 * SPREAD_GRID**2)  # even steps of the logarithm
    return float(prior @ likelihood / prior.sum())


def _losses(found: _Chosen, i: int) -> Array:
    """Losses [nats] on SPREAD_GRID (41,) of the share of active quantity number `i`."""
    shares = [_with_value(found.shares, i, s) for s in SPREAD_GRID]
    return np.array([found.model.loss(each, found.active) for each in shares])


def _with_value(values: Array, i: int, value: float) -> Array:
    changed = values.copy()
    changed[i] = value
    return changed


def _random_unknowns(estimate: Estimate) -> dict[str, Parameter]:
    """Random unknowns of all runs by name."""
    return {p.name: p for run in estimate.evidence.runs for p in run.local if p.random}


def _errors(model: Marginal, active: Sequence[int], shares: Array) -> Array:
    """Standard errors (k,) of the logarithms of the shares, from the curvature of the loss."""
    if not len(active):
        return np.zeros(0)
    logs, k = np.log(shares), len(shares)
    here = model.loss(shares, active)
    curvature = np.zeros(k)
    for i in range(k):
        step = LOG_STEP * np.eye(k)[i]
        ends = [model.loss(np.exp(logs + side * step), active) for side in (-1.0, 1.0)]
        curvature[i] = max((sum(ends) - 2.0 * here) / LOG_STEP**2, LEAST_CURVATURE)
    return np.asarray(1.0 / np.sqrt(curvature))
