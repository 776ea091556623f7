"""Fits restricted to the random unknowns (run-to-run scatter) that the runs show."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cell.gap.fitting.gauss_newton import ROUGH_GAIN, Estimate, refit
from cell.gap.fitting.model import Evidence, Point
from cell.gap.fitting.secants import linearise
from cell.gap.fitting.spreads import Spread, spreads
from cell.gap.fitting.tasks import Simulate, run_one

SPREAD_RATIO = 0.7  # of two spreads, below which they clearly differ; set by hand


def clearly_differ(before: Mapping[str, float], now: Mapping[str, float]) -> bool:
    """Whether two sets of spreads by name differ in their quantities, or clearly in size."""
    return bool(set(before) ^ set(now)) or any(
        not SPREAD_RATIO < now[name] / value < 1.0 / SPREAD_RATIO for name, value in before.items()
    )


def with_own_scatter(
    simulate: Simulate, estimate: Estimate, found: Sequence[Spread], whole: Evidence
) -> Estimate:
    """Refit `estimate` with the spreads `found`, if they clearly differ from those it has.

    Returns it unchanged otherwise; `whole` are the runs with every random unknown.
    """
    used = {p.name: p.spread for run in estimate.evidence.runs for p in run.local if p.random}
    if not clearly_differ(used, {s.name: s.value for s in found}):
        return estimate
    start = with_scatter(estimate, found, whole)
    return run_one(simulate, refit(start.model, start.evidence, start.point))


def with_spreads(known: Evidence, found: Sequence[Spread]) -> Evidence:
    """Copy of `known` that keeps only the random unknowns of `found`, with their spreads."""
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
    """Copy of `estimate` that keeps only the random unknowns of `found`, of the runs `whole`.

    Only its model, evidence and point are valid: residuals are those of the old fit.
    """
    return _with_unknowns(estimate, with_spreads(whole, found))


def estimate_spreads(simulate: Simulate, estimate: Estimate, whole: Evidence) -> tuple[Spread, ...]:
    """Estimate the run-to-run spreads of all random unknowns of `whole`, near `estimate`.

    The estimate may hold some of the unknowns only: it is refitted with all of them first, so that
    its residuals are noise.
    """
    if not any(p.random for run in whole.runs for p in run.local):
        return ()
    here = _with_unknowns(estimate, whole)
    _, jacobians = run_one(simulate, linearise(here.model, here.evidence, here.point))
    again = refit(here.model, here.evidence, here.point, jacobians, ROUGH_GAIN)
    return spreads(run_one(simulate, again))


def _with_unknowns(estimate: Estimate, whole: Evidence) -> Estimate:
    """Copy of `estimate` with the own unknowns of the runs `whole`; new ones are at their start."""
    usual = {run.name: run.local for run in whole.runs}
    runs, local = [], []
    for run, own in zip(estimate.evidence.runs, estimate.point.local, strict=True):
        value = {p.name: float(v) for p, v in zip(run.local, own, strict=True)}
        local.append(np.array([value.get(p.name, p.start) for p in usual[run.name]]))
        runs.append(replace(run, local=usual[run.name]))
    known = Evidence(tuple(runs), estimate.evidence.scales)
    return replace(estimate, evidence=known, point=Point(estimate.shared, tuple(local)))
