"""The last fit of the accepted model, in which no jump of a sample determines an interval."""

from dataclasses import replace

import numpy as np

from cell.gap.fitting.gauss_newton import Estimate, estimate_at, refit
from cell.gap.fitting.secants import both_sides, minmod
from cell.gap.fitting.tasks import Task


def settle(estimate: Estimate) -> Task[Estimate]:
    """Refit `estimate` with slopes that both sides of a value show; the less linear a sample's
    response, the less the sample counts.
    """
    start = yield from _with_slope_errors(estimate)
    refitted = yield from refit(
        start.model, start.evidence, start.point, start.jacobians, both_ways=True
    )
    if np.array_equal(refitted.shared, start.shared):
        return start
    return (yield from _with_slope_errors(refitted))


def _with_slope_errors(estimate: Estimate) -> Task[Estimate]:
    """The same values, with slopes that both sides show; what the linear model then gets wrong of a
    step to either side, in the mean square, counts as noise of the sample.

    Samples that jump together err together, and count as one: by Kish's effective size (1965,
    Survey Sampling) of what a step shows in a run. Statistical linear regression: Lefebvre,
    Bruyninckx and De Schutter 2002, IEEE Transactions on Automatic Control 47, 1406.
    """
    model, known, point = estimate.model, estimate.evidence, estimate.point
    raw, right, left = yield from both_sides(model, known, point)
    scales, slopes = [], []
    for run, scale, a, b in zip(known.runs, known.scales, right, left, strict=True):
        step = np.array([p.step for p in (*model.parameters, *run.local)])
        slope = minmod(a, b)
        wrong = 0.5 * ((a - slope) ** 2 + (b - slope) ** 2) * step**2
        together = wrong.sum(axis=0) ** 2 / np.maximum((wrong**2).sum(axis=0), 1e-300)
        wider = np.sqrt(1.0 + wrong @ together)
        scales.append(scale * wider)
        slopes.append(slope / wider[:, None])
    return estimate_at(model, replace(known, scales=tuple(scales)), point, raw, tuple(slopes))
