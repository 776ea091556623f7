"""Locates gaps between simulation and runs in bins of channel, phase, zone and condition."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.fitting import robust
from cell.gap.fitting.gauss_newton import Estimate
from drivers.types import Array

FEWEST_SAMPLES = 4  # samples that make a bin; set by hand


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
    a wild one counts as much as the fit lets it count.
    Signed mean and energy of each bin, the latter as sqrt(2 chi^2), which is nearly normal
    (Fisher 1925), both standardised by the noise draws; the probability is that of the largest
    statistic over all bins (Westfall and Young 1993, single-step max-T).
    """
    r = np.concatenate(estimate.residuals) / allowed
    bins = _rows_by_bin(estimate)
    rows = list(bins.values())
    whole, drawn = _statistics(r, rows, noise)
    tame, _ = _statistics(robust.clip_residuals(r), rows, noise)
    places = []
    for key, z, judged in zip(bins, whole, np.abs(tame), strict=True):
        p = (1.0 + float((drawn >= judged).sum())) / (1.0 + len(drawn))
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
    bins: dict[tuple[str, str, str, str], list[int]] = defaultdict(list)
    at = 0
    for run in estimate.evidence.runs:
        s = run.samples
        for i in range(len(s)):
            key = (str(s.channel[i]), str(s.phase[i]), str(s.zone[i]), run.condition)
            bins[key].append(at + i)
        at += len(s)
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
