"""Where simulation and measurement disagree: bins of channel, phase, zone and condition."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.gap.fitting import robust
from cell.gap.fitting.gauss_newton import Estimate
from drivers.types import Array

FEWEST_SAMPLES = 4  # samples that make a bin; set by hand


@dataclass(frozen=True, slots=True)
class Bin:
    """A bin: its statistic in standard deviations under noise, and family-wise probability.

    `z` is the stronger of the signed mean (with its sign) and the energy.
    """

    channel: str
    phase: str
    zone: str
    condition: str
    z: float
    p: float


def localise(estimate: Estimate, noise: Array, allowed: Array) -> list[Bin]:
    """All bins, strongest first, judged together against `noise` (N, draws).

    `allowed` (N,) divides the residuals first, for noise beyond the stated one; in probabilities
    a wild one counts as much as the fit lets it count.
    Signed mean and energy of each bin, the latter as sqrt(2 chi^2), which is nearly normal
    (Fisher 1925), both standardised by the noise draws; the probability is that of the largest
    statistic over all bins (Westfall and Young 1993, single-step max-T).
    """
    r = np.concatenate(estimate.residuals) / allowed
    bins = rows_by_bin(estimate)
    rows = list(bins.values())
    whole, drawn = _statistics(r, rows, noise)
    tame, _ = _statistics(robust.clip_residuals(r), rows, noise)
    places = []
    for key, z, judged in zip(bins, whole, np.abs(tame), strict=True):
        p = (1.0 + float((drawn >= judged).sum())) / (1.0 + len(drawn))
        places.append(Bin(*key, float(z), p))
    return sorted(places, key=lambda place: -abs(place.z))


def _statistics(r: Array, rows: Sequence[list[int]], noise: Array) -> tuple[Array, Array]:
    """Of each bin the stronger statistic, and of each draw the strongest of all bins."""
    signed = standardise(np.array([r[i].sum() for i in rows]),
                           np.array([noise[i].sum(axis=0) for i in rows]))  # fmt: skip
    energy = standardise(
        np.sqrt([2.0 * (r[i] ** 2).sum() for i in rows]),
        np.sqrt([2.0 * (noise[i] ** 2).sum(axis=0) for i in rows]),
    )
    largest = np.maximum(np.abs(signed[1]).max(axis=0), energy[1].max(axis=0))
    return np.where(np.abs(signed[0]) >= energy[0], signed[0], energy[0]), largest


def standardise(found: Array, drawn: Array) -> tuple[Array, Array]:
    """Statistics (k,) and draws of them (k, draws), both in standard deviations of the draws."""
    mean, spread = drawn.mean(axis=1), drawn.std(axis=1) + 1e-12
    return (found - mean) / spread, (drawn - mean[:, None]) / spread[:, None]


def rows_by_bin(estimate: Estimate) -> dict[tuple[str, str, str, str], list[int]]:
    """Samples of each bin that has enough of them, by channel, phase, zone and condition."""
    bins: dict[tuple[str, str, str, str], list[int]] = defaultdict(list)
    at = 0
    for run in estimate.evidence.runs:
        s = run.samples
        for i in range(len(s)):
            key = (str(s.channel[i]), str(s.phase[i]), str(s.zone[i]), run.condition)
            bins[key].append(at + i)
        at += len(s)
    return {key: rows for key, rows in bins.items() if len(rows) >= FEWEST_SAMPLES}
