"""Fits of runs with only those random unknowns that the runs were found to have."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cell.gap.fitting.gauss_newton import ROUGH_GAIN, Estimate, refit
from cell.gap.fitting.model import Evidence, Point
from cell.gap.fitting.secants import linearise
from cell.gap.fitting.spreads import Spread, spreads
from cell.gap.fitting.tasks import Simulate, run_one

# of a spread, below which it was in part the response to an effect; set by hand
SPREAD_RATIO = 0.7


def clearly_differ(before: Mapping[str, float], now: Mapping[str, float]) -> bool:
    """Whether two sets of spreads by name hold other quantities, or clearly differ in size."""
    return bool(set(before) ^ set(now)) or any(
        not SPREAD_RATIO < now[name] / value < 1.0 / SPREAD_RATIO for name, value in before.items()
    )


def with_own_scatter(
    simulate: Simulate, estimate: Estimate, found: Sequence[Spread], whole: Evidence
) -> Estimate:
    """The fit with the scatter that was `found` beside it, where that clearly differs from the
    scatter that it was fitted with; else the fit as it is.
    """
    used = {p.name: p.spread for run in estimate.evidence.runs for p in run.local if p.random}
    if not clearly_differ(used, {s.name: s.value for s in found}):
        return estimate
    again = with_scatter(estimate, found, whole)
    return run_one(simulate, refit(again.model, again.evidence, again.point))


def with_spreads(known: Evidence, found: Sequence[Spread]) -> Evidence:
    """The runs of `known` with only those random unknowns that were `found`, and their spreads."""
    value = {s.name: s.value for s in found}
    runs = []
    for run in known.runs:
        kept = [
            replace(p, spread=value[p.name]) if p.random else p
            for p in run.local
            if not p.random or p.name in value
        ]
        runs.append(replace(run, local=tuple(kept)))
    return Evidence(tuple(runs), known.scales)


def with_scatter(estimate: Estimate, found: Sequence[Spread], whole: Evidence) -> Estimate:
    """The fit with only those random unknowns of the runs `whole` that were `found`.

    Only its model, evidence and point count from here on: residuals are those of the old fit.
    """
    return _with_unknowns(estimate, with_spreads(whole, found))


def estimate_spreads(simulate: Simulate, estimate: Estimate, whole: Evidence) -> tuple[Spread, ...]:
    """Spreads of all random unknowns of the runs `whole`, at a fit of the same runs.

    The fit may hold some of the unknowns only: it goes on with all of them, so that what is left
    of the runs is noise.
    """
    if not any(p.random for run in whole.runs for p in run.local):
        return ()
    here = _with_unknowns(estimate, whole)
    _, jacobians = run_one(simulate, linearise(here.model, here.evidence, here.point))
    again = refit(here.model, here.evidence, here.point, jacobians, ROUGH_GAIN)
    return spreads(run_one(simulate, again))


def _with_unknowns(estimate: Estimate, whole: Evidence) -> Estimate:
    """The fit with the own unknowns that the runs of `whole` have; those that it did not have are
    at rest.
    """
    usual = {run.name: run.local for run in whole.runs}
    runs, local = [], []
    for run, own in zip(estimate.evidence.runs, estimate.point.local, strict=True):
        value = {p.name: float(v) for p, v in zip(run.local, own, strict=True)}
        local.append(np.array([value.get(p.name, p.start) for p in usual[run.name]]))
        runs.append(replace(run, local=usual[run.name]))
    known = Evidence(tuple(runs), estimate.evidence.scales)
    return replace(estimate, evidence=known, point=Point(estimate.shared, tuple(local)))
