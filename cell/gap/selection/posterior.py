"""Prior of effects, and posterior of sets of them by the evidence of linearised fits.

An absent effect is expected at an amount that does not matter, by the floor of the
samples; `python -m tests.lab study beliefs` fits the numbers of the prior.

Residuals at the prior mean are normal. Their covariance is that of noise and floor, of
the unknowns under their priors (`Parameter.spread`), of the spike prior of every absent
effect of the library (George and McCulloch 1993, J. Am. Stat. Assoc. 88, 881), and of a
relative model error of each law, smooth in time (Kennedy and O'Hagan 2001, J. R. Stat.
Soc. B 63, 425). The integral over the unknowns is Laplace's (MacKay 2003, Information
Theory, chapter 28).
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import Field
from scipy import special, stats
from scipy.linalg import solve_triangular

from cell.gap.fitting import robust
from cell.gap.fitting.base_fit import projection
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.fitting.normal_equations import Unknowns, inverse_and_logdet
from cell.gap.selection.likelihood import Fits, LikelihoodScale
from cell.gap.selection.screening import ProbeResponses
from drivers.base.settings import Seconds, StudyResult
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

LEAST_NORM = 1e-6  # of a whitened response; a smaller one is rounding
# relative difference (one sigma) of two displacements by one cause; set by hand
EQUAL = 0.025
# share (one sigma) that is left of two changes by one cause; set by hand
CANCELLED = 0.05


class Beliefs(StudyResult):
    """Prior on effects as beliefs.yaml states it: how many are expected, their sizes,
    and errors of their laws.

    Of the library `expected` effects are present. The spike prior of an absent one has
    a response of this share (one sigma, `immaterial`) of what the floor allows. The
    relative model error of a law is half-normal of sigma `wrong`, summed over `shares`,
    with a correlation time `memory` [s].
    """

    FILE = Path(__file__).with_name("beliefs.yaml")

    expected: float = Field(gt=0.0)
    immaterial: float = Field(ge=0.0)
    wrong: float = Field(gt=0.0)
    shares: tuple[float, ...] = Field(min_length=1)
    memory: Seconds = Field(gt=0.0)


def floor_responses(
    base: FitEstimate, probed: Sequence[ProbeResponses], *, believed: bool
) -> dict[str, Array]:
    """Whitened responses (N, k) by effect, scaled to the same energy as the model-error
    floor.

    A column for each group of its probes that the refitted base cannot absorb, scaled
    (least squares over the runs) to the energy of the floor, so that an effect of one
    run alone may fill the floor of that run alone. Where spreads of the base are
    `believed`, its changes against its priors count like residuals: an effect that only
    they separate from the base has a column.
    """
    about = projection(base, robustly=False)
    shares = [run.samples.floor / run.samples.scale for run in base.runs]
    floor = np.array([share @ share for share in shares])
    starts = np.cumsum([0, *map(len, shares[:-1])])

    by_effect: dict[str, Array] = {}
    for effect in probed:
        firsts = np.concatenate([group[:, :1] for group in effect.responses], axis=1)
        left = about.unabsorbed(firsts)
        norms = np.sqrt(np.sum((firsts if believed else left) * left, axis=0))
        felt = norms > LEAST_NORM

        # share of each run in the energy of a response
        by_run = np.add.reduceat(left[:, felt] ** 2, starts, axis=0)
        by_run /= by_run.sum(axis=0)

        size = np.sqrt(floor @ by_run / np.sum(by_run**2, axis=0))
        share = size / np.sqrt(max(felt.sum(), 1))
        by_effect[effect.name] = firsts[:, felt] * (share / norms[felt])
    return by_effect


def spike_responses(library: Mapping[str, Array]) -> list[Array]:
    """Whitened responses (N, k) to absent effects at one standard deviation of their
    spike prior.

    `library` has the responses of the floor's energy.
    """
    return [Beliefs.shipped().immaterial * response for response in library.values()]


class SetProbability(NamedTuple):
    """A set of effects with its probability `p`, and its log evidence plus log prior,
    `nats`.

    `shared` are its pairs of effects, each with the log-odds [nats] that one cause
    outside the library makes both, as a camera and a gripper seem displaced together
    where the desk is.
    """

    names: frozenset[str]
    nats: float
    p: float
    shared: Sequence[tuple[frozenset[str], float]] = ()


class Posterior(NamedTuple):
    """Posterior probabilities of the fitted sets of effects, the most probable set
    first.
    """

    models: Sequence[SetProbability]

    @property
    def inclusion(self) -> dict[str, float]:
        """Probability that each effect is present, by its name, the most probable
        first.
        """
        names = {name for model in self.models for name in model.names}
        shares = {
            name: sum(m.p for m in self.models if name in m.names) for name in names
        }
        return dict(sorted(shares.items(), key=lambda each: (-each[1], each[0])))

    def log_odds(self, holds: Callable[[frozenset[str]], bool]) -> float:
        """Log-odds [nats] that the true set of effects satisfies the condition `holds`;
        infinite if all sets do.

        A set that does counts against it where one cause in place of two effects would
        not.
        """
        held = []
        against = []
        for names, nats, _, shared in self.models:
            if not holds(names):
                against.append(nats)
                continue
            held.append(nats)
            against += [nats + n for two, n in shared if not holds(names - two)]

        if not against:
            return np.inf
        if not held:
            return -np.inf
        return float(special.logsumexp(held) - special.logsumexp(against))

    def lead(self, names: frozenset[str]) -> float:
        """Log posterior odds [nats] of the set `names` against no effect."""
        nats = {model.names: model.nats for model in self.models}
        return nats[names] - nats[frozenset()]


def posterior(
    fits: Fits, likelihood: LikelihoodScale, prior: Beliefs | None = None
) -> Posterior:
    """Posterior probabilities of the sets of effects in `fits`, by the shipped prior by
    default.
    """
    prior = prior or Beliefs.shipped()
    common = _SharedTerms.of(fits, likelihood, prior)
    chance = prior.expected / max(len(fits.library), 2.0 * prior.expected)
    odds = special.logit(chance)
    nats = [common.evidence(model) + odds * len(model.effects) for model in fits.models]
    shares = special.softmax(nats)
    rows = zip(fits.models, nats, shares, strict=True)
    models = [
        SetProbability(names=m.names, nats=n, p=p, shared=shared_causes(m, odds))
        for m, n, p in rows
    ]
    return Posterior(sorted(models, key=lambda w: (-w.nats, sorted(w.names))))


def shared_causes(fit: FitEstimate, odds: float) -> list[tuple[frozenset[str], float]]:
    """Pairs of effects in `fit`, with the log-odds [nats] that one other cause makes
    both.

    Runs show relative places alone: two things that are displaced by the same distance
    may be one other thing that is. And what two effects change hardly ever cancels: the
    little that is left of both may be what one other changes. One cause is an effect
    less, of prior log-odds `odds`.
    """
    _, values = fit.values
    _, changes = fit.model.split(fit.changes)
    pairs = []
    for two in itertools.combinations(fit.effects, 2):
        names = frozenset(e.name for e in two)
        moved = (_displacement(e.parameters, values[e.name] - e.null) for e in two)
        low, high = sorted(moved)
        parts = [changes[e.name].sum(axis=0) for e in two]
        sizes = sum(map(np.linalg.norm, parts))
        left = np.linalg.norm(sum(parts)) / max(sizes, LEAST_NORM)

        unlike = (1.0 - low / (high or 1.0), EQUAL), (float(left), CANCELLED)
        for apart, within in unlike:
            density = stats.halfnorm.logpdf(apart, scale=within)
            pairs.append((names, density - odds))

    return pairs


def _displacement(parameters: Sequence[Parameter], amounts: Array) -> float:
    """Distance [m] by which an effect with the amounts `amounts` (k,) of its
    `parameters` displaces something.
    """
    lengths = [p.unit == "m" and p.is_amount for p in parameters]
    return float(np.linalg.norm(amounts[lengths]))


class _SharedTerms(NamedTuple):
    """Inputs to the evidence of every set: base fit, weights (N,) of samples, spikes
    (N, k).
    """

    base: FitEstimate
    weight: Array
    spikes: dict[str, Array]
    prior: Beliefs

    @classmethod
    def of(
        cls, fits: Fits, likelihood: LikelihoodScale, prior: Beliefs
    ) -> "_SharedTerms":
        """Weights of the samples and spike responses that the evidence of all sets of
        effects in `fits` shares.

        Wild samples are those of the best fit: at its own, a bad model would call wild
        what it does not explain.
        """
        base = fits.base
        scale = likelihood.scale
        best = min(fits.models, key=lambda fit: fit.objective)
        r, _ = _in_units_of(base, best)
        weights = robust.weights(r / scale) / likelihood.inefficiency
        weight = np.sqrt(weights) / scale
        spikes = {name: prior.immaterial * r for name, r in fits.library.items()}
        return cls(base, weight, spikes, prior)

    def evidence(self, fit: FitEstimate) -> float:
        """Log evidence [nats] of a fit, averaged over the relative model errors of its
        laws.
        """
        shares = self.prior.shares if fit.effects else (0.0,)
        mass = np.exp(-0.5 * np.square(np.array(shares) / self.prior.wrong))
        nats = [self._evidence_at(fit, share) for share in shares]
        return float(special.logsumexp(nats, b=mass / mass.sum()))

    def _evidence_at(self, fit: FitEstimate, share: float) -> float:
        """Log evidence [nats] of a fit whose laws have the relative model error
        `share`.
        """
        base = self.base
        model = fit.model
        z = fit.z
        residual, jacobian = _in_units_of(base, fit)
        spikes = [s for name, s in self.spikes.items() if name not in fit.names]
        columns = np.concatenate([residual[:, None], jacobian, *spikes], axis=1)
        explained = base.stacked_residuals - residual
        whitened, logdet = self._whiten(columns, share * explained)
        r = whitened[:, 0]
        responses = whitened[:, 1:]

        count = len(z)
        laws = slice(len(model.base), len(model.parameters))
        limits = _with_proper_priors(fit.unknowns, laws)
        spiked = (0, len(responses.T) - count)
        precision = np.pad(limits.precision, spiked, constant_values=1.0)
        deviation = np.pad(z - limits.mean, spiked)

        # Laplace: the minimum of the loss, and the volume about it
        curvature = responses.T @ responses + np.diag(precision)
        gradient = responses.T @ r + precision * deviation
        inverse, half_logdet = inverse_and_logdet(curvature)
        step = -inverse @ gradient
        loss = r @ r + precision @ deviation**2 + gradient @ step
        nats = -0.5 * float(loss) - 0.5 * logdet - half_logdet
        nats += 0.5 * float(np.log(limits.precision[laws]).sum())

        minimum = z + step[:count]
        variances = np.diag(inverse)[:count]
        return nats + _truncation(limits, minimum, variances, laws)

    def _whiten(self, columns: Array, law_error: Array) -> tuple[Array, float]:
        """Columns (samples, k) whitened by the noise and by `law_error` (samples,), and
        the log determinant of that.
        """
        weighed = columns * self.weight[:, None]
        error = law_error * self.weight
        if not error.any():
            return weighed, 0.0

        logdet = 0.0
        first = 0
        for samples in (run.samples for run in self.base.runs):
            for number in np.unique(samples.series):
                inside = np.flatnonzero(samples.series == number)
                rows = first + inside
                t = samples.t[inside]
                covariance = _error_covariance(t, error[rows], self.prior.memory)
                lower = np.linalg.cholesky(covariance)
                weighed[rows] = solve_triangular(lower, weighed[rows], lower=True)
                logdet += 2.0 * np.log(np.diag(lower)).sum()
            first += len(samples)

        return weighed, logdet


def _error_covariance(t: Array, error: Array, memory: float) -> Array:
    """Covariance (n, n) of unit noise and an error that is smooth over `memory` [s].

    The error is as large as `error` (n,) in the mean square near each of the times `t`
    (n,) [s].
    """
    near = np.exp(-0.5 * ((t[:, None] - t) / memory) ** 2)
    local = np.sqrt((near @ error**2) / near.sum(axis=1))
    covariance: Array = near * local[:, None] * local + np.eye(len(t))
    return covariance


def _in_units_of(base: FitEstimate, fit: FitEstimate) -> tuple[Array, Array]:
    """Residual (N,) and Jacobian (N, size) of `fit`, whitened by the scales of
    `base`.
    """
    runs = zip(fit.runs, base.runs, strict=True)
    unit = np.concatenate([run.samples.scale / of.samples.scale for run, of in runs])
    return fit.stacked_residuals * unit, fit.stacked_jacobian * unit[:, None]


def _with_proper_priors(limits: Unknowns, laws: slice) -> Unknowns:
    """Copy of `limits` in which effect parameters, the slice `laws`, all have a normal
    prior.

    Those without one get a standard deviation of a quarter of their range.
    """
    precision = limits.precision.copy()
    known = precision[laws]
    deviation = 0.25 * (limits.high - limits.low)[laws]
    precision[laws] = np.where(known > 0.0, known, deviation**-2)
    return limits._replace(precision=precision)


def _truncation(limits: Unknowns, mean: Array, variance: Array, laws: slice) -> float:
    """Log ratio [nats] of posterior to prior mass within bounds, summed over parameters
    `laws`.
    """

    bounds = np.array([limits.low[laws], limits.high[laws]])

    def log_mass(middle: Array, deviation: Array) -> Array:
        return _log_normal_mass(*(bounds - middle) / deviation)

    before = log_mass(limits.mean[laws], limits.precision[laws] ** -0.5)
    return float((log_mass(mean[laws], np.sqrt(variance[laws])) - before).sum())


def _log_normal_mass(low: Array, high: Array) -> Array:
    """Log mass (k,) [nats] of the unit normal between `low` (k,) and `high` (k,)."""
    flip = low > 0.0  # into the lower tail, where no digits cancel
    low, high = np.where(flip, -high, low), np.where(flip, -low, high)
    below = special.log_ndtr(low)
    whole = special.log_ndtr(high)
    mass: Array = whole + np.log1p(-np.exp(np.minimum(below - whole, -1e-12)))
    return mass
