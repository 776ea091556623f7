"""Advice: which experiment would separate the accepted explanation from another."""

from types import SimpleNamespace

import numpy as np

from cell.gap.fitting.model import Model
from cell.gap.subject.subject import Candidate, Parameter
from cell.gap.verdict.advice import _alternative


def effect(name: str, probe: float) -> Candidate:
    amount = Parameter("amount", "1", 0.0, -9.0, 9.0, 0.1)
    return Candidate(name, "", "strip", (amount,), (((probe,),),))


def test_without_a_rival_the_first_other_effect_is_compared_at_its_smallest_size() -> None:
    stiffness = Parameter("stiffness", "1", 1.0, 0.1, 9.0, 0.1)
    named, other = effect("named", 0.5), effect("other", 0.25)
    estimate = SimpleNamespace(model=Model((stiffness,), (named,)), shared=np.array([2.0, 3.0]))
    accepted = SimpleNamespace(model=estimate.model, estimate=estimate)
    choice = SimpleNamespace(accepted=accepted, fits=SimpleNamespace(models=(accepted,)), by=None)
    probed = tuple(SimpleNamespace(candidate=c, dead=False) for c in (named, other))
    model, values = _alternative(SimpleNamespace(probed=probed), choice, SimpleNamespace(rivals=()))
    assert [e.name for e in model.effects] == ["other"]
    assert model.split(values)[1]["other"] == [0.25]
    assert values.tolist() == [2.0, 0.25]
