"""Empirical law of residuals that no effect accounts for, tested on held-out runs."""

from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting import Simulate, run_all
from cell.gap.fitting.base_fit import projection
from cell.gap.fitting.crossvalidation import on_runs
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.selection.choice import needed_models
from cell.gap.selection.likelihood import Fits
from cell.gap.selection.posterior import posterior
from cell.gap.selection.screening import (
    probe_equations,
    ranked_pairs,
    ranked_singles,
    run_probes,
)
from cell.gap.selection.search import Search
from cell.gap.subject.subject import Subject

# Thresholds by which a law is offered, set by hand on withheld effects.
LEAST_EXCESS = 0.3  # gap on held-out runs that is worth a law
LEAST_CLOSED = 0.3  # share of it that a law closes
MOST_TERMS = 3
SINGLES, PAIRS = 5, 3  # laws of one term and of two that are refitted
STEADY = 0.7  # share of halves of the runs on which each term keeps its sign


class OfferedLaw(NamedTuple):
    """Formula that describes residuals without naming a cause: a sum of terms with
    fitted amounts, and words for it.

    `base` and `terms` hold values by name; `shrink` is the share of the excess gap on
    held-out runs that it closes.
    """

    base: dict[str, float]
    terms: dict[str, float]
    words: str
    shrink: float


def offered_law(
    subject: Subject,
    simulate: Simulate,
    fits: Fits,
    before: FitEstimate,
    rng: np.random.Generator,
) -> OfferedLaw | None:
    """Most probable formula for the residuals that no effect explains on held-out runs,
    if it is stable; None where there is no such formula.

    `before` is the base on runs that were held out. None where no term is clearly more
    probable than none, no law is stable, or none shrinks the residuals of those runs.
    """
    if held_out_gap.excess_of(before) < LEAST_EXCESS:
        return None

    laws = _fit_laws(subject, simulate, replace(fits, models=(fits.base,)))
    needed = needed_models(laws, posterior(laws, fits.likelihood))
    for law in needed:
        if _stable(law):
            held = law.model.holding(law.shared)
            after = held_out_gap.fit_held_out(simulate, held, before.runs)
            closed = held_out_gap.shrink(before, after, rng).value
            if closed >= LEAST_CLOSED:
                return _offer(law, closed)

    return None


def _fit_laws(subject: Subject, simulate: Simulate, fits: Fits) -> Fits:
    """Copy of `fits` with models made of a few descriptive terms each, the most
    promising ones by a linear estimate.
    """
    base = fits.base
    terms = [term for term in subject.scope.terms if len(term.parameters) == 1]
    probed = run_all(simulate, [run_probes(base, term) for term in terms])
    equations = probe_equations(projection(base), probed)
    scores = [*ranked_singles(equations)[:SINGLES], *ranked_pairs(equations, PAIRS)]
    fits = Search(simulate, terms, probed).fit_scored_models(fits, scores)
    # a term is linear in its amount: beside others its response at null is enough
    search = Search(simulate, [replace(term, probes=()) for term in terms], probed)
    for size in range(1, MOST_TERMS):
        fits = search.extend(fits, fits.near_best(size)[:1])

    return fits


def _stable(estimate: FitEstimate) -> bool:
    """Whether each descriptive term of `estimate` keeps its sign when it is fitted to
    only half of the runs, for most halves.
    """
    first = len(estimate.model.base)
    runs = len(estimate.residuals)
    signs = np.sign(estimate.shared[first:])
    halves = list(combinations(range(runs), max(1, runs // 2)))
    again = [np.sign(on_runs(estimate, half)[0][first:]) for half in halves]
    return bool((np.mean(np.array(again) == signs, axis=0) >= STEADY).all())


def _offer(fit: FitEstimate, shrink: float) -> OfferedLaw:
    """Formula from the fitted descriptive terms of `fit`, which remove the part
    `shrink` of the excess residual on held-out runs.
    """
    values, terms = fit.values
    pairs = zip(fit.model.base, values.tolist(), strict=True)
    base = {p.name: p.stated_value(v) for p, v in pairs}
    amounts = {name: float(amount) for name, (amount,) in terms.items()}
    words = " ".join(
        f"{amount:+.3g} {effect.parameters[0].unit} x {effect.sentence}"
        for effect, amount in zip(fit.effects, amounts.values(), strict=True)
    )
    return OfferedLaw(base=base, terms=amounts, words=words, shrink=shrink)
