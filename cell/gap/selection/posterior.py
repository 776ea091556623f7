"""Which sets of effects are probable: evidence of the linearised fits, with stated priors.

Residuals at the prior mean are normal. Their covariance is that of noise and floor, of the
unknowns under their priors (`Parameter.spread`), of every other effect of the library at an
immaterial amount (a spike that is no point: George and McCulloch 1993, J. Am. Stat. Assoc. 88,
881), and of what a law gets wrong of what it explains, smooth in time (Kennedy and O'Hagan 2001,
J. R. Stat. Soc. B 63, 425). The integral over the unknowns is Laplace's (MacKay 2003, Information
Theory, chapter 28).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special
from scipy.linalg import cho_solve, solve_triangular

from cell.gap.fitting import normal_equations, robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.projection import projection, stacked_jacobian
from cell.gap.selection.fits import Fits
from cell.gap.selection.likelihood import LikelihoodScale
from cell.gap.selection.screening import Probed
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Beliefs:
    """What is held probable before the runs are seen.

    So many effects of the library are `expected` to be there; one that is `immaterial` does so much
    (one sigma) of what the floor allows; a law is wrong by a share of what it explains, half-normal
    of sigma `wrong`, summed over `shares`, and as wrong for `memory` [s]. Source: a prototype on
    thirteen cases of a foreign simulator, in which spikes decided whether an empty case was named.
    """

    expected: float = 1.0
    immaterial: float = 0.12
    wrong: float = 0.1
    shares: tuple[float, ...] = (0.0, 0.05, 0.1, 0.2)
    memory: float = 0.4


DEFAULT_BELIEFS = Beliefs()


@dataclass(frozen=True, slots=True)
class Weighed:
    """A set of effects with its log evidence and prior [nats], and its probability."""

    names: frozenset[str]
    nats: float
    p: float


@dataclass(frozen=True, slots=True)
class Posterior:
    """The sets of effects that were fitted, the most probable first; they sum to one."""

    models: tuple[Weighed, ...]

    @property
    def inclusion(self) -> dict[str, float]:
        """Probability by name that an effect is there, the most probable first."""
        names = {name for model in self.models for name in model.names}
        found = {name: sum(m.p for m in self.models if name in m.names) for name in names}
        return dict(sorted(found.items(), key=lambda each: (-each[1], each[0])))

    def ahead(self, of: Callable[[frozenset[str]], bool]) -> float:
        """Nats by which the best of these sets leads the best other; infinite where there is none,
        negative where it is behind.
        """
        mine = [m.nats for m in self.models if of(m.names)]
        others = [m.nats for m in self.models if not of(m.names)]
        if not mine or not others:
            return float("inf") if mine else float("-inf")
        return max(mine) - max(others)

    def gain(self, names: frozenset[str], effect: str) -> float:
        """Nats by which the set `names` leads itself without `effect`; negative infinity where
        either was not fitted.
        """
        nats = {m.names: m.nats for m in self.models}
        without = names - {effect}
        return nats[names] - nats[without] if {names, without} <= nats.keys() else float("-inf")

    def lead(self, names: frozenset[str]) -> float:
        """Nats by which the set `names` leads the base."""
        nats = {m.names: m.nats for m in self.models}
        return nats[names] - nats[frozenset()]


def posterior(
    fits: Fits,
    probed: Sequence[Probed],
    by: LikelihoodScale,
    beliefs: Beliefs = DEFAULT_BELIEFS,
    *,
    believed: bool = False,
) -> Posterior:
    """Probabilities of the fitted sets; `probed` is the library as it responds at the base.

    Where spreads of the base are `believed`, an effect that only they separate from the base is
    material: what the base would have to strain for it counts as what it leaves.
    """
    about = _About.of(fits, probed, by, beliefs, believed=believed)
    chance = beliefs.expected / max(len(probed), 2.0 * beliefs.expected)
    odds = float(special.logit(chance))
    nats = [about.evidence(m.estimate) + odds * len(m.model.effects) for m in fits.models]
    shares = special.softmax(nats)
    rows = zip(fits.models, nats, shares, strict=True)
    weighed = [Weighed(m.model.names, float(n), float(p)) for m, n, p in rows]
    return Posterior(tuple(sorted(weighed, key=lambda w: (-w.nats, sorted(w.names)))))


@dataclass(frozen=True, slots=True)
class _About:
    """What all sets share: the base, weights (N,) of the samples, and spikes (N, k) by effect."""

    base: Estimate
    weight: Array
    spikes: dict[str, Array]
    beliefs: Beliefs

    @classmethod
    def of(
        cls,
        fits: Fits,
        probed: Sequence[Probed],
        by: LikelihoodScale,
        beliefs: Beliefs,
        *,
        believed: bool,
    ) -> "_About":
        """Wild samples are judged at the best fit, alike for all sets: each at its own would let a
        bad model call what it does not explain wild.
        """
        base, best = fits.base.estimate, min(fits.models, key=lambda m: m.estimate.objective)
        r = _in_units_of(base, best.estimate)[0] / by.scale
        weight = np.sqrt(robust.weights(r) / by.inefficiency) / by.scale
        spikes = _spikes(base, probed, beliefs.immaterial, believed=believed)
        return cls(base, weight, spikes, beliefs)

    def evidence(self, fit: Estimate) -> float:
        """Log evidence [nats] of a fit, averaged over how wrong its laws may be."""
        shares = self.beliefs.shares if fit.model.effects else (0.0,)
        prior = np.exp(-0.5 * np.square(np.array(shares) / self.beliefs.wrong))
        nats = [self._with(fit, share) for share in shares]
        return float(special.logsumexp(nats, b=prior / prior.sum()))

    def _with(self, fit: Estimate, share: float) -> float:
        """The same for laws that are wrong by one `share`."""
        residual, jacobian = _in_units_of(self.base, fit)
        spikes = [s for name, s in self.spikes.items() if name not in fit.model.names]
        columns = np.concatenate([residual[:, None], jacobian, *spikes], axis=1)
        explained = np.concatenate(self.base.residuals) - residual
        whole, logdet = self._whiten(columns, share * explained)
        r, responses = whole[:, 0], whole[:, 1:]
        own = slice(len(fit.model.base), len(fit.model.parameters))
        limits, z = _proper(fit.limits, own), fit.z
        known = np.concatenate([limits.precision, np.ones(responses.shape[1] - len(z))])
        away = np.concatenate([z - limits.mean, np.zeros(len(known) - len(z))])
        curvature = responses.T @ responses + np.diag(known)
        pull = responses.T @ r + known * away
        unit = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        lower = np.linalg.cholesky(curvature * unit[:, None] * unit + 1e-10 * np.eye(len(unit)))
        inverse = cho_solve((lower, True), np.eye(len(unit))) * unit[:, None] * unit
        step = -inverse @ pull
        nats = -0.5 * float(r @ r + known @ away**2 + pull @ step) - 0.5 * logdet
        nats -= float(np.log(np.diag(lower) / unit).sum())
        nats += 0.5 * float(np.log(limits.precision[own]).sum())
        return nats + _truncation(limits, z + step[: len(z)], np.diag(inverse)[: len(z)], own)

    def _whiten(self, columns: Array, wrong: Array) -> tuple[Array, float]:
        """Columns (N, k) in units of noise and of an error `wrong` (N,) of the law, and the log
        determinant of its covariance.
        """
        weighed, error = columns * self.weight[:, None], wrong * self.weight
        if not error.any():
            return weighed, 0.0
        logdet, at = 0.0, 0
        for run in self.base.evidence.runs:
            for number in np.unique(run.samples.series):
                mine = at + np.flatnonzero(run.samples.series == number)
                t = run.samples.t[mine - at]
                lower = np.linalg.cholesky(_smooth(t, error[mine], self.beliefs.memory))
                weighed[mine] = solve_triangular(lower, weighed[mine], lower=True)
                logdet += 2.0 * float(np.log(np.diag(lower)).sum())
            at += len(run.samples)
        return weighed, logdet


def _smooth(t: Array, error: Array, memory: float) -> Array:
    """Covariance (n, n) of unit noise and, beside it, an error as large as `error` (n,) is near by
    at the times `t` (n,) of a series, and as smooth as `memory` [s].
    """
    near = np.exp(-0.5 * ((t[:, None] - t) / memory) ** 2)
    local = np.sqrt((near @ error**2) / near.sum(axis=1))
    return np.asarray(near * local[:, None] * local + np.eye(len(t)))


def _spikes(
    base: Estimate, probed: Sequence[Probed], immaterial: float, *, believed: bool
) -> dict[str, Array]:
    """Whitened responses (N, k) by name to immaterial amounts of each effect: in all the ways that
    it was probed, no more than the share `immaterial` of the floor once the base has moved, the
    base's strain included where its spreads are `believed`.
    """
    about = projection(base, robustly=False)
    floors = [run.samples.floor for run in base.evidence.runs]
    allowed = np.concatenate([f / s for f, s in zip(floors, base.evidence.scales, strict=True)])
    size = immaterial * float(np.linalg.norm(allowed))
    found = {}
    for p in probed:
        ways = np.concatenate([group[:, :1] for group in p.responses], axis=1)
        left = about.left(ways)
        norms = np.sqrt(np.sum((ways if believed else left) * left, axis=0))
        seen = norms > 1e-6
        if seen.any():
            found[p.candidate.name] = ways[:, seen] * (size / norms[seen] / np.sqrt(seen.sum()))
    return found


def _in_units_of(base: Estimate, fit: Estimate) -> tuple[Array, Array]:
    """Residual (N,) and Jacobian (N, size) of a fit, whitened as the base is."""
    scales = zip(fit.evidence.scales, base.evidence.scales, strict=True)
    unit = np.concatenate([mine / its for mine, its in scales])
    return np.concatenate(fit.residuals) * unit, stacked_jacobian(fit) * unit[:, None]


def _proper(limits: normal_equations.Bounds, own: slice) -> normal_equations.Bounds:
    """Limits in which every unknown of `own` has a prior: one of which nothing was known before has
    a quarter of its range for a standard deviation.
    """
    precision = limits.precision.copy()
    wide = 0.25 * (limits.high[own] - limits.low[own])
    precision[own] = np.where(precision[own] > 0.0, precision[own], wide**-2)
    return replace(limits, precision=precision)


def _truncation(limits: normal_equations.Bounds, mean: Array, variance: Array, own: slice) -> float:
    """Log of the share of the posterior within its bounds over that of the prior [nats]; the
    unknowns `own` each by themselves.
    """

    def inside(middle: Array, deviation: Array) -> Array:
        low, high = (limits.low[own] - middle) / deviation, (limits.high[own] - middle) / deviation
        flip = low > 0.0
        low, high = np.where(flip, -high, low), np.where(flip, -low, high)
        share = special.log_ndtr(high) + np.log1p(
            -np.exp(np.minimum(special.log_ndtr(low) - special.log_ndtr(high), -1e-12))
        )
        return np.asarray(share)

    before = inside(limits.mean[own], limits.precision[own] ** -0.5)
    return float((inside(mean[own], np.sqrt(variance[own])) - before).sum())
