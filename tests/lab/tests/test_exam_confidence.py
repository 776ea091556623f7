"""The calibration of the stated confidence, from verdicts held against the truth."""

import re
from pathlib import Path

import numpy as np
import pytest

from cell.gap.verdict.confidence import Calibration, calibration
from cell.gap.verdict.schema import VerdictEvidence
from tests.lab.benchmarks.measure_confidence import verdicts_in
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
from tests.lab.studies.study import Case, Outcome

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
        log_odds, left = (
            float(np.exp(rng.uniform(0.0, 5.0))),
            float(rng.uniform(0.5, 2.0)),
        )
        right = bool(rng.uniform() < 0.3 + 0.13 * np.log1p(log_odds))
        found.append(Name(told(log_odds, left), right, False, str(i)))
    return found


def test_names_are_right_as_often_as_stated() -> None:
    by = fit_calibration(drawn(2000), np.ones(2000), "strip")
    fresh = drawn(2000, seed=1)
    stated = [(by.probability(name.signs), name.right) for name in fresh]
    high = [right for p, right in stated if p > 0.8]
    low = [right for p, right in stated if p < 0.6]
    assert np.mean(high) == pytest.approx(
        np.mean([p for p, _ in stated if p > 0.8]), abs=0.05
    )
    assert np.mean(low) == pytest.approx(
        np.mean([p for p, _ in stated if p < 0.6]), abs=0.07
    )
    assert log_loss(stated) < log_loss([(0.7, name.right) for name in fresh])
    assert "2000 verdicts that accept" in reliable(stated)
    assert "outside" not in reliable(stated)
    assert f"{OUTSIDE_SHARE:.0%} of causes outside" in reliable(
        stated, shares(fresh, 0.4)
    )


def test_names_are_right_only_where_the_effect_is_in_the_library() -> None:
    facts = {
        "case": "a",
        "signs": told(9.0).model_dump(),
        "is_named": True,
        "without": [],
    }
    facts |= {"hidden": ["seam"], "answer": ["seam"], "right": ["seam"]}
    unnamed = {**facts, "is_named": False, "accepted": []}
    values = [
        {**facts, "is_right": True},
        {**facts, "is_right": False, "without": ["seam"]},
        {**unnamed, "without": ["seam"]},
        {**facts, "case": "b", "is_right": True},
        {**unnamed, "accepted": [["seam", "crease"]]},
        {**unnamed, "hidden": [], "answer": []},
        {**unnamed, "hidden": ["wobble"], "answer": []},
    ]
    outcomes = [Outcome(Case(i, 0, {}), v) for i, v in enumerate(values)]
    found, outside = names(outcomes)
    assert [name.right for name in found] == [True, False, True, True]
    assert outside == 0.5
    two = Outcome(Case(7, 0, {}), {**unnamed, "accepted": [["seam"], ["crease"]]})
    assert [name.right for name in names([two])[0]] == [False]
    content = calibrate(outcomes)
    assert "4 verdicts that accept, 1 of them wrong" in content["source"]
    assert Calibration.model_validate(
        {**content, "belongs_to": "confidence.yaml"}
    ).weights


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["strip", "mechanism"])
def test_the_package_holds_the_calibration_of_its_source(kind: str) -> None:
    shipped = calibration(kind)
    ledgers = re.findall(r"[a-z]+-[a-z0-9]+\.jsonl", shipped.source)
    outcomes = verdicts_in([LEDGERS / name for name in ledgers])
    found = Calibration.model_validate(calibrate(outcomes, kind))
    assert shipped.source.startswith(found.source)
    assert found.intercept == pytest.approx(shipped.intercept, abs=1e-3)
    for sign, w in shipped.weights.items():
        assert found.weights[sign].weight == pytest.approx(w.weight, abs=1e-3)
