"""Run-to-run spreads by restricted maximum likelihood (REML), and uncertainty of fitted
values.

Random unknowns u of a run, such as where a strip is grasped, are drawn anew in each run
with mean zero and a standard deviation s_q that all runs share. With all other unknowns
integrated out, the linearised fit is quadratic in u: curvature C, gradient -g, about u
= 0. Then, up to a constant,

    -log p(data | s) = 1/2 log |C + S^-2| + sum_i log s_q(i) - 1/2 g' (C + S^-2)^-1 g

with S = diag(s_q(i)) (Patterson and Thompson 1971, Biometrika 58, 545; Pinheiro and
Bates 2000, Mixed-effects models in S and S-PLUS, section 2.2). Spreads are shares of
the usual one, each with a half-normal prior of unit width, which stands in where runs
are few.

Noise and what differs from run to run average out over runs; an error that all runs
share does not. It is no unknown of the fit, which would take it for an effect: its
spread, as measured beforehand, is carried through the fit to the values (a considered
parameter: Schmidt 1966, Application of state-space methods to navigation problems).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from scipy import optimize

from cell.gap.fitting import Simulate, normal_equations, robust, run_one
from cell.gap.fitting.gauss_newton import ROUGH_GAIN, FitEstimate, refit
from cell.gap.fitting.model import Point
from cell.gap.subject.subject import FitRun
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

# Set by hand, and tried on true spreads. Spreads are in units of each quantity's usual
# one; these are the bounds between which they are sought, and from where.
SMALLEST, LARGEST, FIRST = 0.03, 5.0, 0.5
# times as wide is the prior of the constant part of a quantity, the same in all runs
SHARED = 10.0
LEAST_NOISE = 0.1  # share of its stated variance that noise has at least
COMMON = 0.9  # prior probability with which a common quantity scatters
LEAST_GAIN = 3.0  # nats that another quantity must gain
TIE = 2.0  # nats from the best within which the first quantity is added
# of a spread's logarithm, over which the loss or a variance is differentiated
LOG_STEP = 0.1
LEAST_CURVATURE = 0.1  # of the loss
DIFFER = 0.7  # ratio of two spreads below which they clearly differ
# Degrees of freedom of a variance, set by hand: a spread's prior holds as much
# information as six runs, and the most stand for infinitely many.
LEAST_FREEDOM, MOST_FREEDOM = 5.0, 1e6
SPREAD_GRID = np.geomspace(SMALLEST, LARGEST, 41)
"""Shares of the usual spread at which its posterior is evaluated."""
CENTRAL_95 = 1.96  # standard deviations of a normal, within which 95 % lie


@dataclass(frozen=True, slots=True)
class Spread:
    """Standard deviation of a quantity from run to run, with its 95 % interval `low` to
    `high`.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float

    @property
    def error(self) -> float:
        """Standard error of the natural logarithm of the run-to-run spread."""
        return float(np.log(self.high / self.low)) / (2.0 * CENTRAL_95)


def reml_spreads(estimate: FitEstimate) -> tuple[Spread, ...]:
    """Estimate how much the random unknowns of `estimate` scatter from run to run, by
    restricted maximum likelihood (REML).

    Common ones scatter in most laboratories: each takes its posterior mean, which
    allows for no scatter, and is left out where that is below `SMALLEST`. The others
    are added one by one while each gains enough beside those: scatter of the slack and
    of the grip look alike.
    """
    varying = {p.name: p for run in estimate.runs for p in run.local if p.random}
    if not varying or len(estimate.runs) < 2:
        return ()

    likelihood = Likelihood.of(estimate, varying)
    parameters = list(varying.values())
    common = [k for k, p in enumerate(parameters) if p.common]
    fit = SpreadFit.of(likelihood, common, np.full(len(common), FIRST))
    fit = _add_uncommon(fit, len(varying))
    chosen = [parameters[k] for k in fit.active]
    shares = np.array(
        [fit.mean_share(i, common=p.common) for i, p in enumerate(chosen)]
    )
    errors = likelihood.errors(fit.active, np.maximum(shares, SMALLEST))
    rows = zip(chosen, shares, errors, strict=True)
    return tuple(_spread(p, s, error) for p, s, error in rows if s >= SMALLEST)


def _spread(p: Parameter, fraction: float, error: float) -> Spread:
    """Run-to-run spread of `p`: its prior spread times `fraction`, with an interval
    from the `error` of its logarithm.
    """
    value = fraction * p.spread
    factor = np.exp(CENTRAL_95 * error)
    return Spread(
        name=p.name, unit=p.unit, value=value, low=value / factor, high=value * factor
    )


class Likelihood(NamedTuple):
    """Restricted likelihood of the run-to-run spreads of q random quantities.

    `curvature` (u, u) and minus the gradient, `descent` (u,), of the u random unknowns
    are C and g of the module's equation, in units of the `usual` (q,) spreads; `owner`
    (u,) is the index of an unknown's quantity.
    """

    curvature: Array
    descent: Array
    owner: Array
    usual: Array

    @classmethod
    def of(cls, estimate: FitEstimate, varying: dict[str, Parameter]) -> Self:
        """Likelihood of the spreads of `varying`, random unknowns by name, in the fit
        `estimate`.

        All other unknowns are integrated out of the linearised fit, and so is the
        constant part of each quantity: a constant error of the rig is no scatter.
        """
        parameters = estimate.unknowns.parameters
        order = list(varying)
        owner = np.array([order.index(p.name) if p.random else -1 for p in parameters])
        usual = np.array([varying[name].spread for name in order])
        curvature, descent = _equations(estimate, parameters, owner, usual)
        random = np.flatnonzero(owner >= 0)
        fixed = np.setdiff1d(np.arange(len(curvature)), random)
        unit = usual[owner[random]]
        across = np.linalg.solve(
            curvature[np.ix_(fixed, fixed)], curvature[np.ix_(fixed, random)]
        )
        left = (
            curvature[np.ix_(random, random)]
            - curvature[np.ix_(random, fixed)] @ across
        )
        return cls(
            curvature=0.5 * (left + left.T) * unit[:, None] * unit,
            descent=(descent[random] - across.T @ descent[fixed]) * unit,
            owner=owner[random],
            usual=usual,
        )

    def loss(self, shares: Array, active: Sequence[int]) -> tuple[float, Array]:
        """Negative log posterior [nats], up to a constant, of run-to-run spreads given
        as `shares` (k,) of their usual values, and its gradient (k,) by their
        logarithms.

        The shares are those of the quantities `active`; the others do not scatter.
        """
        scattering, owner = np.nonzero(np.equal.outer(self.owner, active))
        own = shares[owner]
        precision = own**-2
        posterior = self.curvature[np.ix_(scattering, scattering)] + np.diag(precision)
        covariance, half_logdet = normal_equations.inverse_and_logdet(posterior)
        descent = self.descent[scattering]
        mean = covariance @ descent  # of u, given the shares
        loss = half_logdet + np.log(own).sum()
        loss += 0.5 * (shares @ shares - descent @ mean)
        # d / d log s of the module's equation
        slope = 1.0 - precision * (np.diag(covariance) + mean**2)
        return loss, np.bincount(owner, slope, len(active)) + shares**2

    def errors(self, active: Sequence[int], shares: Array) -> Array:
        """Standard errors (k,) of the logarithms of the spreads' `shares` (k,), from
        the curvature of the loss.
        """

        def at(logs: Array) -> float:
            return self.loss(np.exp(logs), active)[0]

        logs = np.log(shares)
        steps = LOG_STEP * np.eye(len(logs))
        middle = at(logs)
        second = [at(logs + h) + at(logs - h) - 2.0 * middle for h in steps]
        curvature = np.array(second) / LOG_STEP**2
        return 1.0 / np.sqrt(np.maximum(curvature, LEAST_CURVATURE))


def _equations(
    estimate: FitEstimate,
    parameters: Sequence[Parameter],
    owner: Array,
    usual_spreads: Array,
) -> tuple[Array, Array]:
    """Curvature (m, m) and minus gradient (m,) of a fit without priors on random
    unknowns.

    The m unknowns are all those of the fit, then the constant part of each random
    quantity.
    """
    r = estimate.stacked_residuals
    columns = estimate.stacked_jacobian
    variance = robust.long_run_variance(estimate.runs, estimate.residuals)
    variance = max(LEAST_NOISE, variance)
    weight = np.sqrt(robust.weights(r / estimate.scale) / variance) / estimate.scale

    prior = np.array([0.0 if p.random else p.spread**-2 for p in parameters])
    z = estimate.z
    without_scatter = r - columns @ np.where(owner >= 0, z, 0.0)
    prior_pull = prior * (z - estimate.unknowns.mean)

    common_prior = (SHARED * usual_spreads) ** -2
    common = columns @ np.equal.outer(owner, np.arange(len(common_prior)))

    weighted = np.concatenate([columns, common], axis=1) * weight[:, None]
    curvature = weighted.T @ weighted + np.diag(np.concatenate([prior, common_prior]))
    # keeps it positive definite
    curvature += np.diag(1e-9 * np.diag(curvature) + 1e-12)
    prior_pull = np.pad(prior_pull, (0, len(common_prior)))
    return curvature, -(weighted.T @ (without_scatter * weight) + prior_pull)


class SpreadFit(NamedTuple):
    """Most likely run-to-run spreads of the quantities numbered `active`, as `shares`
    (k,) of their prior spreads.
    """

    likelihood: Likelihood
    active: Sequence[int]
    shares: Array
    loss: float

    @classmethod
    def of(cls, likelihood: Likelihood, active: Sequence[int], start: Array) -> Self:
        """Find the most likely spreads of the quantities numbered `active`, as shares
        (k,) of their priors, from `start` (k,).
        """
        if not active:
            return cls(
                likelihood=likelihood,
                active=active,
                shares=start,
                loss=likelihood.loss(start, active)[0],
            )
        optimum = optimize.minimize(
            lambda x: likelihood.loss(np.exp(x), active),
            np.log(start),
            jac=True,
            method="L-BFGS-B",
            bounds=optimize.Bounds(*np.log([SMALLEST, LARGEST])),
        )
        return cls(
            likelihood=likelihood,
            active=active,
            shares=np.exp(optimum.x),
            loss=optimum.fun,
        )

    def mean_share(self, i: int, *, common: bool) -> float:
        """Posterior mean of the spread of quantity number `i`, as a share of its prior,
        at the others' most likely spreads.

        With few runs the likelihood of a spread has a long tail to large values, so
        that its peak is mostly too small. For a `common` quantity the mean allows for
        no scatter at all, too.
        """
        trials = np.tile(self.shares, (len(SPREAD_GRID), 1))
        trials[:, i] = SPREAD_GRID
        losses = np.array(
            [self.likelihood.loss(each, self.active)[0] for each in trials]
        )
        likely = SPREAD_GRID * np.exp(losses.min() - losses)
        mean: float = likely @ SPREAD_GRID / likely.sum()
        if not common:
            return mean

        odds = COMMON / (1.0 - COMMON) * self._bayes_factor(i, losses)
        return mean * (odds / (1.0 + odds))

    def _bayes_factor(self, i: int, losses: Array) -> float:
        """Bayes factor for scatter of the active quantity `i` against none, from its
        `losses` (41,) on SPREAD_GRID.
        """
        others = [k for j, k in enumerate(self.active) if j != i]
        none, _ = self.likelihood.loss(np.delete(self.shares, i), others)
        likelihood = np.exp(np.clip(none + 0.5 * SPREAD_GRID**2 - losses, -50.0, 50.0))
        # even steps of the logarithm
        prior = SPREAD_GRID * np.exp(-0.5 * SPREAD_GRID**2)
        return float(prior @ likelihood / prior.sum())


def _add_uncommon(fit: SpreadFit, count: int) -> SpreadFit:
    """Add to `fit`, one by one, those of `count` quantities whose scatter raises the
    likelihood.
    """
    while len(active := fit.active) < count:
        absent = [k for k in range(count) if k not in active]
        start = np.append(fit.shares, FIRST)
        trials = [SpreadFit.of(fit.likelihood, [*active, k], start) for k in absent]
        lowest = min(trial.loss for trial in trials)
        best = next(trial for trial in trials if trial.loss < lowest + TIE)
        if fit.loss - best.loss < LEAST_GAIN:
            break
        fit = best
    return fit


def clearly_differ(before: Mapping[str, float], now: Mapping[str, float]) -> bool:
    """Whether two sets of spreads have other names, or a spread changes by more than
    DIFFER.
    """
    return bool(set(before) ^ set(now)) or any(
        not DIFFER < now[name] / value < 1.0 / DIFFER for name, value in before.items()
    )


def with_spreads(runs: Sequence[FitRun], spreads: Sequence[Spread]) -> list[FitRun]:
    """Copies of `runs` with `spreads` as priors of their random unknowns; random
    unknowns without a spread are removed.
    """
    by_name = {spread.name: spread.value for spread in spreads}
    found = []
    for run in runs:
        known = [replace(p, spread=by_name.get(p.name, p.spread)) for p in run.local]
        local = [p for p in known if not p.random or p.name in by_name]
        found.append(replace(run, local=local))
    return found


def with_unknowns(
    estimate: FitEstimate, complete: Sequence[FitRun]
) -> tuple[list[FitRun], Point]:
    """Runs of `estimate` with all the unknowns of the `complete` runs, and values from
    which to fit them.

    A fit can begin there; samples and their scales stay those of the estimate.
    """
    unknowns = {run.name: run.local for run in complete}
    runs = []
    local = []
    for run, values in zip(estimate.runs, estimate.local, strict=True):
        names = [p.name for p in run.local]
        known = dict(zip(names, values, strict=True))
        own = unknowns[run.name]
        local.append(np.array([known.get(p.name, p.start) for p in own]))
        runs.append(replace(run, local=own))
    return runs, Point(estimate.shared, local)


def estimate_spreads(
    simulate: Simulate, estimate: FitEstimate, complete: Sequence[FitRun]
) -> tuple[Spread, ...]:
    """Run-to-run spreads (REML) of all random unknowns of the runs `complete`, from a
    refit of `estimate`.

    The estimate may hold some of the unknowns only: it is refitted with all of them
    first, so that its residuals are noise.
    """
    if not any(p.random for run in complete for p in run.local):
        return ()
    runs, start = with_unknowns(estimate, complete)
    refitted = refit(estimate.model, runs, start, enough=ROUGH_GAIN)
    return reml_spreads(run_one(simulate, refitted))


def covariance(estimate: FitEstimate, inefficiency: float) -> Array:
    """Covariance (k, k) of all k unknowns of a fit, where `inefficiency` correlated
    samples count as one independent sample.
    """
    inverse = normal_equations.covariance(estimate.normal().curvature)
    errors = _common_error_responses(estimate)
    if not errors.shape[1]:
        return inverse * inefficiency
    scale = estimate.scale
    weight = robust.weights(estimate.stacked_residuals / scale) / scale**2
    common = inverse @ (estimate.stacked_jacobian.T @ (weight[:, None] * errors))
    return inverse * inefficiency + common @ common.T


def _common_error_responses(estimate: FitEstimate) -> Array:
    """Whitened residuals (samples, k) that one standard deviation of each of k errors
    common to all runs causes.
    """
    names = list(dict.fromkeys(name for run in estimate.runs for name in run.common))
    parts = []
    for run in estimate.runs:
        scale = run.samples.scale
        rows = [run.common.get(name, np.zeros(len(scale))) / scale for name in names]
        parts.append(np.array(rows).reshape(len(names), len(scale)).T)
    return np.concatenate(parts)


def degrees_of_freedom(
    estimate: FitEstimate, inefficiency: float, scatter: Sequence[Spread]
) -> Array:
    """Degrees of freedom (k,) of the variances of the k unknowns of a fit, for
    Student's t distribution.

    2 V^2 / var V, where var V follows from the errors of the logarithms of the spreads
    `scatter` (Satterthwaite 1946, An approximate distribution of estimates of variance
    components).
    """
    variance = _variance(estimate, inefficiency, {})
    uncertainty = np.zeros_like(variance)
    for spread in scatter:
        more, less = (
            _variance(estimate, inefficiency, {spread.name: np.exp(side * LOG_STEP)})
            for side in (1.0, -1.0)
        )
        uncertainty += ((more - less) / (2.0 * LOG_STEP) * spread.error) ** 2
    least = np.maximum(2.0 * variance**2 / MOST_FREEDOM, np.finfo(float).tiny)
    return np.maximum(2.0 * variance**2 / np.maximum(uncertainty, least), LEAST_FREEDOM)


def _variance(
    estimate: FitEstimate, inefficiency: float, factors: dict[str, float]
) -> Array:
    """Variance (k,) of all k unknowns of a fit, with run-to-run spreads multiplied by
    `factors` by name.
    """

    def with_factor(p: Parameter) -> Parameter:
        return replace(p, spread=p.spread * factors.get(p.name, 1.0)) if p.random else p

    runs = [replace(run, local=[*map(with_factor, run.local)]) for run in estimate.runs]
    return np.diag(covariance(replace(estimate, runs=runs), inefficiency))
