"""Fits of runs with only those random unknowns that the runs were found to have."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cell.gap.fitting.gauss_newton import ROUGHLY, Estimate, linearised, refit
from cell.gap.fitting.model import Evidence, Point
from cell.gap.fitting.spreads import Spread, spreads
from cell.gap.fitting.tasks import Simulate, run_one


def scattered(known: Evidence, found: Sequence[Spread]) -> Evidence:
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
    if not any(p.random for run in whole.runs for p in run.local):
        return estimate
    opened = _opened(estimate, whole)
    known = scattered(opened.evidence, found)
    local = tuple(
        np.array([v for p, v in zip(run.local, own, strict=True) if p.name in kept])
        for run, own, kept in zip(
            opened.evidence.runs,
            opened.point.local,
            [{p.name for p in run.local} for run in known.runs],
            strict=True,
        )
    )
    return replace(opened, evidence=known, point=Point(estimate.shared, local))


def estimated(simulate: Simulate, estimate: Estimate, whole: Evidence) -> tuple[Spread, ...]:
    """Spreads of all random unknowns of the runs `whole`, at a fit of the same runs.

    The fit may hold some of the unknowns only: it goes on with all of them, so that what is left
    of the runs is noise.
    """
    if not any(p.random for run in whole.runs for p in run.local):
        return ()
    here = _opened(estimate, whole)
    _, jacobians = run_one(simulate, linearised(here.model, here.evidence, here.point))
    again = refit(here.model, here.evidence, here.point, jacobians, ROUGHLY)
    return spreads(run_one(simulate, again))


def _opened(estimate: Estimate, whole: Evidence) -> Estimate:
    """The fit with all random unknowns of `whole`; those that it did not have are at rest."""
    usual = {run.name: run.local for run in whole.runs}
    runs, local = [], []
    for run, own in zip(estimate.evidence.runs, estimate.point.local, strict=True):
        value = {p.name: float(v) for p, v in zip(run.local, own, strict=True)}
        local.append(np.array([value.get(p.name, p.start) for p in usual[run.name]]))
        runs.append(replace(run, local=usual[run.name]))
    known = Evidence(tuple(runs), estimate.evidence.scales)
    return replace(estimate, evidence=known, point=Point(estimate.shared, tuple(local)))
