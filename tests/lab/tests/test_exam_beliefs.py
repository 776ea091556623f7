"""The study that fits the prior beliefs of the posterior."""

from collections.abc import Callable
from itertools import product

from cell.gap.selection.posterior import Beliefs
from tests.lab.studies.catalogue.beliefs import (
    IMMATERIAL,
    STUDY,
    WRONG_SIGMAS,
    fit_beliefs,
)
from tests.lab.studies.study import Case as StudyCase, Outcome


def outcome(nats: Callable[[float, float], float]) -> Outcome:
    scores = [
        {"immaterial": i, "wrong": w, "nats": nats(i, w)}
        for i, w in product(IMMATERIAL, WRONG_SIGMAS)
    ]
    return Outcome(StudyCase(0, 0, {}), {"scores": scores})


def test_the_fitted_beliefs_score_best_over_all_cases() -> None:
    small = outcome(lambda i, w: -i)
    middle = outcome(lambda i, w: -4.0 * abs(i - 0.09) - abs(w - 0.2))
    found = Beliefs.model_validate(fit_beliefs([small, middle, middle]))
    assert (found.immaterial, found.wrong) == (0.09, 0.2)
    assert found.memory == Beliefs.shipped().memory
    assert "0.09 -0.0" in found.source
    assert Beliefs.model_validate(fit_beliefs([small])).immaterial == min(IMMATERIAL)
    assert Beliefs.FILE.as_posix().endswith(STUDY.fits[0].path)
