"""A law that describes the gap where no effect accounts for it, refitted and proven."""

from dataclasses import dataclass

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.diagnosis.sparse_law import describe
from cell.gap.fitting.crossvalidation import Validated, validate
from cell.gap.fitting.gauss_newton import Estimate, refit
from cell.gap.fitting.model import Evidence, Model, Point
from cell.gap.fitting.projection import projection
from cell.gap.fitting.tasks import Simulate, run_all, run_one
from cell.gap.selection.likelihood import LikelihoodScale, margin
from cell.gap.selection.screening import probe
from cell.gap.subject.subject import Subject

LEAST = 0.3  # share of the excess gap on held-out runs that a law must close, to be offered
NOTHING = 0.3  # excess gap that is none to close


@dataclass(frozen=True, slots=True)
class OfferedLaw:
    """Terms of the subject with their refitted amounts: a description, and no cause.

    `base` and `terms` hold values by name; `shrink` is the share of the excess gap on held-out
    runs that it closes.
    """

    base: dict[str, float]
    terms: dict[str, float]
    words: str
    shrink: float


def offered_law(
    subject: Subject,
    simulate: Simulate,
    base: Validated,
    by: LikelihoodScale,
    before: Estimate,
    rng: np.random.Generator,
) -> OfferedLaw | None:
    """A stable law of what the base leaves, where it also shrinks the gap `before` on unseen runs.

    None where no law is stable, none gains on runs left out, or no run that was held out shows a
    gap that it closes.
    """
    if float(held_out_gap.excess(held_out_gap.run_squares(before))) < NOTHING:
        return None
    fit = base.estimate
    probed = run_all(simulate, [probe(fit, t) for t in subject.scope.terms])
    law = describe(fit, projection(fit), probed, by.inefficiency, rng)
    if law is None or not law.stable:
        return None
    terms = tuple(t for t in subject.scope.terms if t.name in law.names)
    if any(len(t.parameters) > 1 for t in terms):
        return None
    model = Model(fit.model.base, terms)
    start = Point(model.joined(fit.shared, {}), fit.point.local)
    done = run_one(simulate, validate(run_one(simulate, refit(model, fit.evidence, start))))
    if margin(done, base, by).gain < by.least:
        return None
    shrink = _closed(simulate, done.estimate, before, rng)
    return _offer(done.estimate, shrink.value) if shrink.value >= LEAST else None


def _closed(
    simulate: Simulate, fit: Estimate, before: Estimate, rng: np.random.Generator
) -> held_out_gap.Shrink:
    """Share of the excess gap of `before` that a fit closes on the same runs."""
    known = Evidence(before.evidence.runs, before.evidence.scales)
    after = held_out_gap.unseen(simulate, fit, known)
    squares = held_out_gap.run_squares(before), held_out_gap.run_squares(after)
    return held_out_gap.shrink(*squares, rng)


def _offer(fit: Estimate, shrink: float) -> OfferedLaw:
    values, terms = fit.model.split(fit.shared)
    base = {p.name: p.shown(float(v)) for p, v in zip(fit.model.base, values, strict=True)}
    amounts = {e.name: float(terms[e.name][0]) for e in fit.model.effects}
    words = " ".join(
        f"{amounts[e.name]:+.3g} {e.parameters[0].unit} x {e.sentence}" for e in fit.model.effects
    )
    return OfferedLaw(base, amounts, words, shrink)
