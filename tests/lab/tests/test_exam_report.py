"""The report of an exam: what its table counts, and every miss in words."""

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cell.base.campaign.journal import Journal, Record
from cell.base.campaign.run import Local
from cell.gap.verdict.schema import Verdict
from tests.lab.__main__ import app
from tests.lab.exam.case import Case
from tests.lab.exam.run import EXAMS, facts, quantities
from tests.lab.exam.score import score
from tests.lab.studies.campaign import StudyRequest
from tests.lab.studies.study import figure
from tests.support.exam_cases import case, named, verdict
from tests.support.gap_strip_cases import denim


def scored(hidden: Case, said: Verdict) -> dict[str, Any]:
    outcome = score(said, hidden, denim())
    known_facts = {"case": hidden.model_dump(mode="json")}
    stored = {"outcome": outcome.model_dump(mode="json")}
    return known_facts | stored | facts(hidden, outcome)


def single(name: str, strength: str, said: Verdict) -> dict[str, Any]:
    effects = {"desk_tilt": {"angle": 0.01}}
    return scored(case(name, "single", effects, strength=strength), said)


def tilted(value: float) -> Verdict:
    return named("desk_tilt", parameters={"angle": (value, 0.5 * value, 2.0 * value)})


def test_right_names_are_counted_from_medium_strength_on() -> None:
    weak = single("w", "weak", verdict("no_gap"))
    assert (weak["strict"], weak["weak misnamed"]) == (None, False)
    clear = single("a", "medium", tilted(0.01))
    assert (clear["strict"], clear["by class"], clear["covered"]) == (
        True,
        True,
        [True],
    )
    wrong = single("b", "strong", named("seam"))
    assert (wrong["strict"], wrong["by class"], wrong["alarm"]) == (False, False, None)


def test_a_case_without_a_verdict_is_not_right_and_raises_no_alarm() -> None:
    lost = case("a", "single", {"desk_tilt": {"angle": 0.01}}, strength="strong")
    assert facts(lost)["strict"] is False
    quiet = facts(case("n", "nothing", {}))
    assert (quiet["no gap"], quiet["alarm"]) == (None, None)


def test_few_cases_without_an_alarm_do_not_show_that_there_are_few() -> None:
    alarms = {tier: quantities(tier)[1] for tier in ("state", "images")}
    assert not figure(alarms["state"], 20 * [[False]]).held
    assert figure(alarms["state"], 100 * [[False]]).held
    assert figure(alarms["images"], 20 * [[False]]).held


def test_one_of_a_pair_is_not_both() -> None:
    effects = {"desk_tilt": {"angle": 0.01}, "seam": {"factor": 2.0}}
    pair = case("p", "pair", effects, tier="images", strength="medium")
    half = scored(pair, named("seam"))
    assert (half["one of two"], half["both"]) == (True, False)
    assert scored(pair, named("seam", "desk_tilt"))["both"]


def outcomes() -> list[dict[str, Any]]:
    """A right case, a wrong name, and one without a verdict."""
    lost = case("lost", "single", {"crease": {"angle": 0.1}}, strength="weak")
    reason = {"outcome": None, "reason": "no verdict after 600 s"}
    return [
        single("tilt", "medium", tilted(0.012)),
        single("fooled", "strong", named("seam", "air_drag", confidence=0.8)),
        {"case": lost.model_dump(mode="json")} | reason | facts(lost),
    ]


@pytest.mark.parametrize("tier", ["state", "small"])
def test_an_exam_that_is_finished_is_only_reported_with_every_miss(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tier: str
) -> None:
    monkeypatch.setattr(Local, "measure", lambda *_: pytest.fail("judged again"))
    asked = StudyRequest(EXAMS[tier], 7, 3, tmp_path)
    for part, values in zip(asked.parts(), outcomes(), strict=True):
        facts = {"schema": 1, "key": part.key, "of": part.of, "state": "measured"}
        Journal(asked.journal).put(Record(**facts, outcome={"values": values}))
    command = f"exam --tier {tier} --cases 3 --seed 7 --out {tmp_path}"
    done = CliRunner().invoke(app, command.split())
    assert done.exit_code == int(tier == "small"), done.output
    assert done.stdout == f"1 of 3 right: {tmp_path / 'exam.md'}\n"
    page = (tmp_path / "exam.md").read_text()
    assert "exam --tier state --seed 7 --cases 3`" in page
    misses = [line for line in page.splitlines() if line.startswith("- `")]
    assert [line.split("`")[1] for line in misses] == ["fooled", "lost"]
    assert "desk_tilt (angle 0.01)" in misses[0]
    assert "said named (seam, air_drag), confidence 0.80" in misses[0]
    assert "no verdict after 600 s" in misses[1]
