"""The model of a subject at its stated values, as if it left nothing of the runs."""

import numpy as np

from cell.gap.batch import Simulate, alone
from cell.gap.model import Model, Point, evidence
from cell.gap.refit import Estimate, linearised
from cell.gap.subject import Subject


def stated(subject: Subject, simulate: Simulate) -> Estimate:
    """The base of `subject` where its file has it: what else responds is judged from there."""
    known, model = evidence(subject.runs), Model(subject.scope.base)
    point = Point(np.array([p.start for p in model.parameters]), known.start())
    raw, jacobians = alone(simulate, linearised(model, known, point))
    nothing = tuple(np.zeros(len(r.mean)) for r in raw)
    return Estimate(model, known, point, nothing, tuple(raw), jacobians, 1.0, 0.0)
