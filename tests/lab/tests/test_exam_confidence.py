"""The calibration of the stated confidence, from verdicts held against the truth."""

import re
from pathlib import Path

import numpy as np
import pytest

from cell.gap.verdict.confidence import LogOddsCalibration, calibration
from cell.gap.verdict.schema import VerdictEvidence
from tests.lab.benchmarks.measure_confidence import verdicts_in
from tests.lab.exam.score import claim_on
from tests.lab.studies.catalogue.confidence import (
    OUTSIDE_SHARE,
    Name,
    calibrate,
    fit_calibration,
    log_loss,
    names,
    reliable,
    shares,
)
from tests.support.exam_cases import case, named, verdict

LEDGERS = Path(__file__).parents[1] / "ledgers"


def told(
    log_odds: float, left: float = 0.6, correlation: float = 0.0
) -> VerdictEvidence:
    """VerdictEvidence of a verdict whose unseen runs are predicted 100 nats better."""
    return VerdictEvidence(
        log_odds=log_odds, gain=100.0, left=left, correlation=correlation
    )


def drawn(count: int, seed: int = 0) -> list[Name]:
    """Names that are right the more often the farther they lead, whatever else is
    seen.
    """
    rng = np.random.default_rng(seed)
    found = []
    for i in range(count):
        log_odds, left = np.exp(rng.uniform(0.0, 5.0)), rng.uniform(0.5, 2.0)
        right = rng.uniform() < 0.3 + 0.13 * np.log1p(log_odds)
        found.append(Name(told(log_odds, left), right, False, str(i)))
    return found


def test_names_are_right_as_often_as_stated() -> None:
    by = fit_calibration(drawn(2000), np.ones(2000), "strip")
    fresh = drawn(2000, seed=1)
    stated = [(by.probability(name.signs), name.right) for name in fresh]
    for least, most, off in ((0.8, 1.0, 0.05), (0.0, 0.6, 0.07)):
        some = [(p, right) for p, right in stated if least < p < most]
        p, right = np.mean(some, axis=0)
        assert right == pytest.approx(p, abs=off)
    assert log_loss(stated) < log_loss([(0.7, name.right) for name in fresh])
    assert "2000 verdicts that accept" in reliable(stated)
    assert "outside" not in reliable(stated)
    assert f"{OUTSIDE_SHARE:.0%} of causes outside" in reliable(
        stated, shares(fresh, 0.4)
    )


def test_claims_count_where_they_accept_something_and_have_signs() -> None:
    facts = {"signs": told(9.0).model_dump(), "outside": False, "hides": True}
    claims = [
        {**facts, "case": "a", "right": True},
        {**facts, "case": "b", "right": False, "outside": True},
        {**facts, "case": "c", "right": None, "outside": True},
        {**facts, "case": "d", "right": True},
        {**facts, "case": "e", "right": None, "hides": False},
        {**facts, "case": "f", "right": True, "signs": None},
    ]
    found, outside = names(claims)
    assert [name.right for name in found] == [True, False, True]
    assert outside == 0.4
    content = calibrate(claims)
    assert "3 verdicts that accept, 1 of them wrong" in content["source"]
    assert LogOddsCalibration.model_validate(
        {**content, "belongs_to": "confidence.yaml"}
    ).weights


def test_what_is_accepted_of_an_exam_is_right_by_class_and_never_if_withheld() -> None:
    seam = case("a", "single", {"seam": {"factor": 2.0}})
    outside = case("b", "outside", {}, causes={"wobble": {"amplitude": 0.01}})
    for said, hidden, right in (
        (named("seam"), seam, True),
        (named("crease"), seam, False),
        (verdict("ambiguous", classes=[["seam", "crease"]]), seam, True),
        (verdict("ambiguous", classes=[["seam"], ["crease"]]), seam, False),
        (verdict("unexplained"), seam, None),
        (named("seam"), outside, False),
    ):
        found = claim_on(said, hidden)
        assert (found["right"], found["outside"]) == (right, hidden is outside)
    withheld = claim_on(named("seam"), seam, withheld=True)
    assert (withheld["right"], withheld["outside"]) == (False, True)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["strip", "mechanism"])
def test_the_package_holds_the_calibration_of_its_source(kind: str) -> None:
    shipped = calibration(kind)
    ledgers = re.findall(r"[a-z]+-[a-z0-9]+\.jsonl", shipped.source)
    claims = verdicts_in([LEDGERS / name for name in ledgers])
    found = LogOddsCalibration.model_validate(calibrate(claims, kind))
    assert shipped.source.startswith(found.source)
    assert found.intercept == pytest.approx(shipped.intercept, abs=1e-3)
    for sign, w in shipped.weights.items():
        assert found.weights[sign].weight == pytest.approx(w.weight, abs=1e-3)
