"""Last fit of the accepted model, in which no jump of a sample narrows an interval."""

from dataclasses import replace

import numpy as np

from cell.gap.fitting.gauss_newton import Estimate, estimate_at, refit
from cell.gap.fitting.secants import both_sides, minmod
from cell.gap.fitting.tasks import Task


def settle(estimate: Estimate) -> Task[Estimate]:
    """Refit `estimate` with two-sided slopes, weighting down samples that respond nonlinearly."""
    start = yield from _with_slope_errors(estimate)
    refitted = yield from refit(
        start.model, start.evidence, start.point, start.jacobians, both_ways=True
    )
    if np.array_equal(refitted.shared, start.shared):
        return start
    return (yield from _with_slope_errors(refitted))


def _with_slope_errors(estimate: Estimate) -> Task[Estimate]:
    """Copy of `estimate` with two-sided slopes, whose error counts as noise of the samples.

    It is the mean square of what the linear model gets wrong of a step to either side. Samples that
    jump together err together, and count as one: by Kish's effective size (1965, Survey Sampling)
    of the error of a step in a run. Statistical linear regression: Lefebvre, Bruyninckx and De
    Schutter 2002, IEEE Transactions on Automatic Control 47, 1406.
    """
    model, known, point = estimate.model, estimate.evidence, estimate.point
    raw, right, left = yield from both_sides(model, known, point)
    scales, slopes = [], []
    for run, scale, a, b in zip(known.runs, known.scales, right, left, strict=True):
        step = np.array([p.step for p in (*model.parameters, *run.local)])
        slope = minmod(a, b)
        error = 0.5 * ((a - slope) ** 2 + (b - slope) ** 2) * step**2
        effective_size = error.sum(axis=0) ** 2 / np.maximum((error**2).sum(axis=0), 1e-300)
        wider = np.sqrt(1.0 + error @ effective_size)
        scales.append(scale * wider)
        slopes.append(slope / wider[:, None])
    return estimate_at(model, replace(known, scales=tuple(scales)), point, raw, tuple(slopes))
