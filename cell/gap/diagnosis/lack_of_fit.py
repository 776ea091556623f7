"""Lack of fit: whether a model leaves more than noise, overall and in which places."""

from collections import defaultdict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy import special

from cell.gap.fitting import robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Evidence
from cell.gap.fitting.projection import projection
from cell.gap.subject.subject import Run
from drivers.types import Array

K = TypeVar("K", bound=Hashable)
FEWEST_SAMPLES = 4  # samples that make a bin; set by hand


@dataclass(frozen=True, slots=True)
class Testing:
    """Settings of the lack-of-fit test. Source: set by hand.

    Repeats are compared in bins of `bin_time` [s], as long as the samples of a strip; noise is
    drawn `draws` times.
    """

    bin_time: float = 0.3
    draws: int = 400


TESTING = Testing()
SIGNIFICANT = 0.01  # probability below which repeats scatter by more than the noise; customary


def pure_error(
    estimate: Estimate, residuals: Sequence[Array] | None = None, spent: int = 0
) -> dict[str, float]:
    """Factor (>= 1) by channel on the stated noise that the scatter between repeats demands.

    `residuals` stand in for the estimate's own, `spent` degrees of freedom went into them.
    Variance of bin means between runs of one condition over what the noise explains, accepted
    where its chi-square probability is below 1 % (Draper and Smith, Applied Regression
    Analysis, lack of fit and pure error).
    """
    squares: dict[str, float] = defaultdict(float)
    freedom: dict[str, int] = defaultdict(int)
    for bins in _repeat_bins(estimate, residuals or estimate.residuals).values():
        for channel, mean, count in bins:
            centre = np.average(mean, weights=count)
            squares[channel] += float((count * (mean - centre) ** 2).sum())
            freedom[channel] += len(mean) - 1
    factors = {}
    for channel, dof in freedom.items():
        left = max(1, dof - spent)
        excess = special.chdtrc(left, squares[channel]) < SIGNIFICANT
        factors[channel] = max(1.0, float(np.sqrt(squares[channel] / left))) if excess else 1.0
    return factors


def _repeat_bins(
    estimate: Estimate, residuals: Sequence[Array]
) -> dict[str, list[tuple[str, Array, Array]]]:
    """Channel, means and counts (runs,) of each bin that repeats share, by condition."""
    bins: dict[tuple[str, str, str, str, int], list[tuple[float, int]]] = defaultdict(list)
    for run, r in zip(estimate.evidence.runs, residuals, strict=True):
        for key, rows in _rows_by([run], _place_and_time).items():
            bins[(run.condition, *key)].append((float(r[rows].mean()), len(rows)))
    repeats: dict[str, list[tuple[str, Array, Array]]] = defaultdict(list)
    for (condition, channel, *_), values in bins.items():
        if len(values) > 1:
            mean, count = np.array(values).T
            repeats[condition].append((channel, mean, count))
    return repeats


def _place_and_time(run: Run, i: int) -> tuple[str, str, str, int]:
    """Channel, phase, zone and time bin of sample number `i` of a run."""
    return (*_place(run, i), int(run.samples.t[i] / TESTING.bin_time))


def _rows_by(runs: Sequence[Run], key: Callable[[Run, int], K]) -> dict[K, list[int]]:
    """Row numbers in the stacked samples of `runs`, by the `key` of each sample of a run."""
    rows: dict[K, list[int]] = defaultdict(list)
    first = 0
    for run in runs:
        for i in range(len(run.samples)):
            rows[key(run, i)].append(first + i)
        first += len(run.samples)
    return rows


def _place(run: Run, i: int) -> tuple[str, str, str]:
    """Channel, phase and zone of sample number `i` of a run."""
    s = run.samples
    return str(s.channel[i]), str(s.phase[i]), str(s.zone[i])


def lack_of_fit(estimate: Estimate, noise: Array, allowed: Array) -> float:
    """p-value, under noise, of the largest standardised mean square over channels and conditions.

    `noise` (N, draws) are residuals that noise alone would leave (`noise_left`); `allowed` (N,)
    divides the residuals first (`slack`); an outlier counts as much as the fit lets it count.
    """
    r = robust.clip_residuals(np.concatenate(estimate.residuals) / allowed)
    by_channel = _rows_by(
        estimate.evidence.runs, lambda run, i: (run.samples.channel[i], run.condition)
    )
    rows = list(by_channel.values())
    observed = np.array([np.mean(r[i] ** 2) for i in rows])
    drawn = np.array([np.mean(noise[i] ** 2, axis=0) for i in rows])
    mean, spread = drawn.mean(axis=1, keepdims=True), drawn.std(axis=1, keepdims=True) + 1e-12
    worst = float(((observed[:, None] - mean) / spread).max())
    null = ((drawn - mean) / spread).max(axis=0)
    return (1.0 + float((null >= worst).sum())) / (1.0 + len(null))


def noise_left(estimate: Estimate, rng: np.random.Generator) -> Array:
    """Draws of the residuals (N, draws) that noise and run-to-run scatter leave after a fit.

    Parametric bootstrap of the linearised model (Davison and Hinkley 1997, section 6.3).
    """
    about = projection(estimate, robustly=False)
    noise = rng.standard_normal((len(about.residual), TESTING.draws))
    if about.scatter.shape[1]:
        noise += about.scatter @ rng.standard_normal((about.scatter.shape[1], TESTING.draws))
    return about.left(noise)


def slack(evidence: Evidence, inflation: Mapping[str, float]) -> Array:
    """Factor (N,) that widens the scale of each sample: the `inflation` of its channel's noise."""
    return np.array(
        [inflation.get(str(c), 1.0) for run in evidence.runs for c in run.samples.channel]
    )


@dataclass(frozen=True, slots=True)
class Bin:
    """A bin of samples: test statistic `z` [sigma] and family-wise p-value `p`.

    `z` is the stronger of the signed mean (with its sign) and the energy.
    """

    channel: str
    phase: str
    zone: str
    condition: str
    z: float
    p: float


def localise(estimate: Estimate, noise: Array, allowed: Array) -> list[Bin]:
    """Test all bins together against `noise` (N, draws); returns them, the strongest first.

    `allowed` (N,) divides the residuals first, for noise beyond the stated one; in probabilities
    an outlier counts as much as the fit lets it count.
    Signed mean and energy of each bin, the latter as sqrt(2 chi^2), which is nearly normal
    (Fisher 1925), both standardised by the noise draws; the probability is that of the largest
    statistic over all bins (Westfall and Young 1993, single-step max-T).
    """
    r = np.concatenate(estimate.residuals) / allowed
    bins = _rows_by_bin(estimate)
    rows = list(bins.values())
    statistics, drawn = _statistics(r, rows, noise)
    bounded, _ = _statistics(robust.clip_residuals(r), rows, noise)
    places = []
    for key, z, bounded_z in zip(bins, statistics, np.abs(bounded), strict=True):
        p = (1.0 + float((drawn >= bounded_z).sum())) / (1.0 + len(drawn))
        places.append(Bin(*key, float(z), p))
    return sorted(places, key=lambda place: -abs(place.z))


def _statistics(r: Array, rows: Sequence[list[int]], noise: Array) -> tuple[Array, Array]:
    """Stronger statistic (k,) of each bin, and the strongest of all bins in each draw (draws,)."""
    signed, signed_draws = _standardise(
        np.array([r[i].sum() for i in rows]), np.array([noise[i].sum(axis=0) for i in rows])
    )
    energy, energy_draws = _standardise(
        np.sqrt([2.0 * (r[i] ** 2).sum() for i in rows]),
        np.sqrt([2.0 * (noise[i] ** 2).sum(axis=0) for i in rows]),
    )
    largest = np.maximum(np.abs(signed_draws).max(axis=0), energy_draws.max(axis=0))
    return np.where(np.abs(signed) >= energy, signed, energy), largest


def _standardise(found: Array, drawn: Array) -> tuple[Array, Array]:
    """Statistics (k,) and draws of them (k, draws), both in standard deviations of the draws."""
    mean, spread = drawn.mean(axis=1), drawn.std(axis=1) + 1e-12
    return (found - mean) / spread, (drawn - mean[:, None]) / spread[:, None]


def _rows_by_bin(estimate: Estimate) -> dict[tuple[str, str, str, str], list[int]]:
    """Row numbers of each bin with enough samples, by channel, phase, zone and condition."""
    bins = _rows_by(estimate.evidence.runs, lambda run, i: (*_place(run, i), run.condition))
    return {key: rows for key, rows in bins.items() if len(rows) >= FEWEST_SAMPLES}


def matching_bins(
    base: Estimate, fitted: Estimate, others: Sequence[Estimate], noise: Array, allowed: Array
) -> list[Bin]:
    """Test, in each bin, how well residuals of `base` match what the model `fitted` adds.

    Returns the bins, the surest first. Each sample counts by what the model predicts otherwise than
    the base (matched filter), against `noise` (N, draws), divided by what is `allowed` (N,) beyond
    it. The model was chosen in sight of the residuals, so that a draw counts by its strongest bin
    under the response of any of the models tried, this one and `others`, with either sign (Westfall
    and Young 1993).
    """
    r = np.concatenate(base.residuals)
    weight = (r - np.concatenate(fitted.residuals)) / allowed
    bins = _rows_by_bin(base)
    rows = list(bins.values())
    found, drawn = _match_sums(robust.clip_residuals(r / allowed), weight, rows, noise)
    largest = np.abs(drawn).max(axis=0)
    for other in others:
        tried = (r - np.concatenate(other.residuals)) / allowed
        largest = np.maximum(largest, np.abs(_match_sums(r, tried, rows, noise)[1]).max(axis=0))
    places = []
    for (key, at), z in zip(bins.items(), found, strict=True):
        p = (1.0 + float((largest >= z).sum())) / (1.0 + len(largest))
        side = 1.0 if weight[at].sum() >= 0.0 else -1.0
        places.append(Bin(*key, side * float(z), p))
    return sorted(places, key=lambda place: (place.p, -abs(place.z)))


def stronger_of_two(by_itself: Sequence[Bin], by_effect: Sequence[Bin]) -> list[Bin]:
    """Bins with the smaller p-value of two tests, doubled for that choice; strongest first."""
    if not by_effect:
        return list(by_itself)
    other = {_key(b): b for b in by_effect}
    surer = [min(b, other[_key(b)], key=lambda one: one.p) for b in by_itself]
    corrected = [replace(b, p=min(1.0, 2.0 * b.p)) for b in surer]
    return sorted(corrected, key=lambda place: -abs(place.z))


def _key(b: Bin) -> tuple[str, str, str, str]:
    return b.channel, b.phase, b.zone, b.condition


def _match_sums(
    r: Array, weight: Array, rows: Sequence[list[int]], noise: Array
) -> tuple[Array, Array]:
    """Standardised weighted sums over bins of `r` (N,) and of `noise` (N, draws)."""
    return _standardise(
        np.array([r[i] @ weight[i] for i in rows]), np.array([weight[i] @ noise[i] for i in rows])
    )
