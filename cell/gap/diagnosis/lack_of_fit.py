"""Lack-of-fit test for a gap: whether residuals exceed the noise that repeats show."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy import special

from cell.gap.fitting import robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Evidence
from cell.gap.fitting.projection import projection
from cell.gap.subject.subject import Run
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Testing:
    """Settings of the lack-of-fit test. Source: set by hand.

    Repeats are compared in bins of `bin_time` [s], as long as the samples of a strip; noise is
    drawn `draws` times; a model must describe at least `described` runs before one more may be an
    outlier.
    """

    bin_time: float = 0.3
    draws: int = 400
    described: int = 6


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
        for key, rows in _rows_by_bin(run).items():
            bins[(run.condition, *key)].append((float(r[rows].mean()), len(rows)))
    found: dict[str, list[tuple[str, Array, Array]]] = defaultdict(list)
    for (condition, channel, *_), values in bins.items():
        if len(values) > 1:
            mean, count = np.array(values).T
            found[condition].append((channel, mean, count))
    return found


def _rows_by_bin(run: Run) -> dict[tuple[str, str, str, int], list[int]]:
    """Row numbers of a run's samples by channel, phase, zone and time bin."""
    rows: dict[tuple[str, str, str, int], list[int]] = defaultdict(list)
    s = run.samples
    for i in range(len(s)):
        key = (str(s.channel[i]), str(s.phase[i]), str(s.zone[i]), int(s.t[i] / TESTING.bin_time))
        rows[key].append(i)
    return rows


def lack_of_fit(estimate: Estimate, noise: Array, allowed: Array) -> float:
    """p-value, under noise, of the largest standardised mean square over channels and conditions.

    `noise` (N, draws) are residuals that noise alone would leave (`noise_left`); `allowed` (N,)
    divides the residuals first (`slack`); a wild one counts as much as the fit lets it count.
    """
    r = robust.clip_residuals(np.concatenate(estimate.residuals) / allowed)
    rows = _groups(estimate)
    found = np.array([np.mean(r[i] ** 2) for i in rows])
    drawn = np.array([np.mean(noise[i] ** 2, axis=0) for i in rows])
    mean, spread = drawn.mean(axis=1, keepdims=True), drawn.std(axis=1, keepdims=True) + 1e-12
    worst = float(((found[:, None] - mean) / spread).max())
    null = ((drawn - mean) / spread).max(axis=0)
    return (1.0 + float((null >= worst).sum())) / (1.0 + len(null))


def _groups(estimate: Estimate) -> list[NDArray[np.int64]]:
    """Row numbers of the samples of each channel in each condition."""
    runs = estimate.evidence.runs
    channel = np.concatenate([run.samples.channel for run in runs])
    condition = np.concatenate([np.full(len(run.samples), run.condition) for run in runs])
    keys = sorted(set(zip(channel.tolist(), condition.tolist(), strict=True)))
    return [np.flatnonzero((channel == c) & (condition == of)) for c, of in keys]


def noise_left(estimate: Estimate, rng: np.random.Generator) -> Array:
    """Draws of the residuals (N, draws) that noise and run-to-run scatter leave after a fit.

    Parametric bootstrap of the linearised model (Davison and Hinkley 1997, section 6.3).
    """
    about = projection(estimate, robustly=False)
    noise = rng.standard_normal((len(about.residual), TESTING.draws))
    if about.scatter.shape[1]:
        noise += about.scatter @ rng.standard_normal((about.scatter.shape[1], TESTING.draws))
    return about.left(noise)


def slack(
    evidence: Evidence,
    inflation: Mapping[str, float],
    tolerance: Mapping[str, float] = MappingProxyType({}),
) -> Array:
    """Factor (N,) that widens the scale of each sample beyond its stated noise.

    `inflation` multiplies the noise of a channel, `tolerance` [SI] adds to that of a quantity.
    """
    factors = []
    for run, scale in zip(evidence.runs, evidence.scales, strict=True):
        more = np.array([inflation.get(str(c), 1.0) for c in run.samples.channel])
        extra = np.array([tolerance.get(str(c), 0.0) for c in run.samples.quantity])
        factors.append(np.hypot(more * scale, extra) / scale)
    return np.concatenate(factors)


def outlying_run(estimate: Estimate) -> tuple[str | None, NDArray[np.bool_]]:
    """Name of the run with the largest residuals, None of few runs, and its sample mask (N,)."""
    squares = [float(np.mean(robust.clip_residuals(r) ** 2)) for r in estimate.residuals]
    owner = np.repeat(np.arange(len(squares)), [len(r) for r in estimate.residuals])
    if len(squares) <= TESTING.described:
        return None, np.zeros(len(owner), dtype=bool)
    worst = int(np.argmax(squares))
    return estimate.evidence.runs[worst].name, owner == worst


def lost_samples(estimate: Estimate) -> NDArray[np.bool_]:
    """Mask (N,) of samples that the model lost while it predicts others of their run.

    The strip lies down in another place there, which is for the other channels to judge.
    """
    lost = [np.isnan(raw.mean) for raw in estimate.raw]
    return np.concatenate([rows & ~rows.all() for rows in lost])
