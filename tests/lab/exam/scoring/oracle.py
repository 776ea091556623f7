"""Best possible result with the truth known: the true effects, refitted on the same runs."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting.gauss_newton import Estimate, refit
from cell.gap.fitting.model import Evidence, Model, Point, evidence
from cell.gap.fitting.projection import projection
from cell.gap.fitting.reml import spreads, with_spreads
from cell.gap.fitting.tasks import Simulate, run_all
from cell.gap.selection.screening import probe, ranking, table, with_effects
from cell.gap.subject.run_folders import RunFolder
from cell.gap.subject.strip.subject import open_strip
from cell.gap.subject.subject import Candidate, Subject
from drivers.strip.describe import load_strip
from drivers.strip.effects import registry
from drivers.types import Array
from tests.lab.exam.case import Case
from tests.lab.exam.scoring.results import Oracle


def oracle(
    case: Case, strip: Path, runs: Sequence[RunFolder], held_out: Sequence[str]
) -> Oracle | None:
    """Refit the case's true effects and compare with the refitted base on the held-out runs.

    Laws of the library are refitted from the truth; effects that a cause resembles from where a
    screen finds them. Run-to-run spreads are estimated beside the true effects. None where
    the answer is empty or the library cannot simulate it.
    """
    subject = open_strip(strip, runs)
    known = {c.name for c in subject.scope.candidates}
    if not case.answer or not known.issuperset(case.answer):
        return None
    train = evidence([run for run in subject.runs if run.name not in held_out])
    test = evidence([run for run in subject.runs if run.name in held_out])
    start = _true_base(case, strip, subject)
    base = _refit(subject.simulate, Model(subject.scope.base), train, [start])
    model = with_effects(base.model, case.answer, subject.scope.candidates)
    if case.alike:
        starts = [model.join(start, _true_values(case, model.effects))]
    else:
        starts = _screened_starts(subject.simulate, base, model)
    scatter = spreads(_refit(subject.simulate, model, train, starts))
    train, test = with_spreads(train, scatter), with_spreads(test, scatter)
    base = _refit(subject.simulate, base.model, train, [base.shared])
    whole = _refit(subject.simulate, model, train, starts)
    before, after = (_excess(subject.simulate, fit, test) for fit in (base, whole))
    return Oracle(after=after, shrink=1.0 - after / before if before > 0.0 else 0.0)


def _true_base(case: Case, path: Path, subject: Subject) -> Array:
    """Base parameters (p,) of the true plant, start values for those that it does not have."""
    strip = load_strip(path)
    length, time = case.stiffness * strip.bending_length, case.damping * strip.retardation_time
    true = {"bending_length": length, "retardation_time": time}
    return np.array([true.get(p.name, p.start) for p in subject.scope.base])


def _true_values(case: Case, effects: Sequence[Candidate]) -> dict[str, Array]:
    """True parameters (p,) of each effect by name, in the gap engine's units."""
    found = {}
    for effect in effects:
        true = registry()[effect.name].complete(case.effects[effect.name])
        values = [
            (1.0 / true[p.name] if p.inverse else true[p.name]) if p.name in true else p.start
            for p in effect.parameters
        ]
        found[effect.name] = np.array(values)
    return found


def _screened_starts(simulate: Simulate, base: Estimate, model: Model) -> list[Array]:
    """Start values (p,) of two fits: without effects, and with each effect as screened alone."""
    probed = run_all(simulate, [probe(base, effect) for effect in model.effects])
    scores = ranking(table(projection(base), probed))
    values = {name: value for score in scores for name, value in score.start.items()}
    return [model.join(base.shared, {}), model.join(base.shared, values)]


def _refit(simulate: Simulate, model: Model, runs: Evidence, starts: Sequence[Array]) -> Estimate:
    """Fit from each of the start values; returns the estimate with the least objective."""
    tasks = [refit(model, runs, Point(start, runs.start())) for start in starts]
    return min(run_all(simulate, tasks), key=lambda estimate: estimate.objective)


def _excess(simulate: Simulate, fit: Estimate, test: Evidence) -> float:
    return held_out_gap.excess_of(held_out_gap.unseen(simulate, fit, test))
