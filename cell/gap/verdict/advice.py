"""Advice on separating the accepted explanation from its strongest rival."""

from dataclasses import replace

import numpy as np

from cell.gap.diagnosis.next_experiment import advise, repeatability_gains
from cell.gap.fitting.model import Model, evidence
from cell.gap.fitting.scatter import with_spreads
from cell.gap.fitting.tasks import Simulate, rough, run_one
from cell.gap.selection.choice import Choice
from cell.gap.subject.subject import Subject
from cell.gap.verdict.findings import Advised, Judged, Screened
from drivers.types import Array


def advice(
    subject: Subject, screened: Screened, choice: Choice, judged: Judged, simulate: Simulate
) -> Advised:
    """Experiments and better repeats that would separate the accepted model from a rival.

    Planned runs scatter in the quantities that scatter in the runs so far.
    """
    second = _alternative(screened, choice, judged)
    if second is None:
        return Advised()
    first = choice.accepted.estimate
    more = run_one(simulate, repeatability_gains(first, second, choice.by))
    experiments = [
        replace(e, run=with_spreads(evidence([e.run]), judged.scatter).runs[0])
        for e in subject.experiments()
    ]
    planned = run_one(rough(simulate), advise(first, second, experiments, choice.by))
    return Advised(tuple(planned), tuple(more))


def _alternative(screened: Screened, choice: Choice, judged: Judged) -> tuple[Model, Array] | None:
    """Model to separate first from the accepted one, with its shared values (P,)."""
    if judged.rivals:
        other = judged.rivals[0].model
        return other.model, other.estimate.shared
    size = len(choice.accepted.model.effects) or 1
    others = [m for m in choice.fits.models
              if len(m.model.effects) == size and m is not choice.accepted]  # fmt: skip
    if others:
        best = min(others, key=lambda m: float(m.losses(choice.by.scale).sum()))
        return best.model, best.estimate.shared
    accepted = choice.accepted.estimate
    known = {effect.name for effect in accepted.model.effects}
    alive = [p.candidate for p in screened.probed
             if not p.dead and p.candidate.name not in known]  # fmt: skip
    if not alive:
        return None
    candidate, (base, _) = alive[0], accepted.model.split(accepted.shared)
    smallest = np.array(candidate.probes[0][0])
    model = Model(accepted.model.base, (candidate,))
    return model, model.join(base, {candidate.name: smallest})
