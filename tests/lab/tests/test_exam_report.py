"""The report of an exam: what the ledger holds, in words that a technician reads."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from cell.base.campaign.journal import Journal, Record
from cell.base.campaign.run import Local
from cell.gap.verdict.schema import Verdict
from tests.lab.__main__ import app
from tests.lab.exam.case import Case
from tests.lab.exam.page import markdown
from tests.lab.exam.run import EXAMS, Entry
from tests.lab.exam.score import Oracle, score
from tests.lab.exam.targets import targets
from tests.lab.studies.campaign import StudyRequest
from tests.support.exam_cases import case, named, verdict
from tests.support.gap_strip_cases import denim


def scored(hidden: Case, said: Verdict, known: float = 1.0) -> Entry:
    return Entry(
        case=hidden,
        outcome=score(said, hidden, denim()),
        oracle=Oracle(after=0.0, shrink=known) if hidden.answer else None,
    )


def single(name: str, strength: str, said: Verdict, **changes: str) -> Entry:
    effects = {"desk_tilt": {"angle": 0.01}}
    return scored(case(name, "single", effects, strength=strength, **changes), said)


def tilted(value: float) -> Verdict:
    return named("desk_tilt", parameters={"angle": (value, 0.5 * value, 2.0 * value)})


def met(entries: list[Entry], words: str, tier: str = "images") -> bool | None:
    [line] = [t for t in targets(entries, tier) if words in t.words]  # type: ignore[arg-type]
    return line.met


def test_right_names_are_counted_from_medium_strength_on() -> None:
    weak = [single(f"w{i}", "weak", verdict("no_gap"), tier="images") for i in range(9)]
    clear = [single("a", "medium", tilted(0.01), tier="images")]
    assert met(weak + clear, "strictly") is True
    wrong = single("b", "strong", named("seam"), tier="images")
    assert met([*weak, *clear, wrong], "strictly") is False
    assert met(weak + clear, "at weak strength") is True


def test_a_case_without_a_verdict_is_not_right() -> None:
    right = single("a", "strong", tilted(0.01), tier="images")
    lost = Entry(case=right.case, reason="its process died")
    assert met([right], "strictly") is True
    assert met([right, lost], "strictly") is False


def test_few_cases_without_an_alarm_do_not_show_that_there_are_few() -> None:
    quiet = [
        scored(case(f"n{i}", "nothing", {}), verdict("no_gap")) for i in range(100)
    ]
    assert met(quiet[:20], "an effect named where nothing", "state") is False
    assert met(quiet, "an effect named where nothing", "state") is True
    assert met(quiet[:20], "an effect named where nothing") is True


def test_six_cases_of_six_are_no_miss_where_a_single_one_decides() -> None:
    quiet = [scored(case(f"n{i}", "nothing", {}), verdict("no_gap")) for i in range(6)]
    rows = [
        line
        for line in markdown(quiet, "").splitlines()
        if "where nothing is hidden" in line
    ]
    assert any("too few cases" in row for row in rows)
    assert not any("missed" in row for row in rows)
    alarms = [scored(case(f"n{i}", "nothing", {}), named("seam")) for i in range(60)]
    assert markdown(alarms, "").count("**missed**") >= 2


def test_pairs_and_shrink_are_held_against_their_targets() -> None:
    effects = {"desk_tilt": {"angle": 0.01}, "seam": {"factor": 2.0}}
    pair = case("p", "pair", effects, tier="images", strength="medium")
    half = scored(pair, named("seam"))
    assert met([half], "at least one") is True
    assert met([half], "both") is False
    assert met([half], "knowing the truth") is True
    better = scored(pair, named("seam", "desk_tilt"), known=1.2)
    assert met([better], "knowing the truth") is False


def entries() -> list[Entry]:
    bad = named("seam", "air_drag", confidence=0.8)
    lost = case("lost", "single", {"crease": {"angle": 0.1}}, strength="weak")
    return [
        scored(case("silent", "nothing", {}), verdict("no_gap")),
        single("tilt", "medium", tilted(0.012)),
        single("fooled", "strong", bad),
        scored(
            case(
                "air", "outside", {}, causes={"draught": {"speed": 0.3}}, tier="images"
            ),
            verdict("unexplained"),
        ),
        Entry(case=lost, reason="no verdict after 600 s"),
    ]


def test_the_page_lists_every_miss_and_nothing_else_as_one() -> None:
    page = markdown(entries(), "")
    misses = [line for line in page.splitlines() if line.startswith("- `")]
    assert [line.split("`")[1] for line in misses] == ["fooled", "lost"]
    assert "desk_tilt (angle 0.01)" in misses[0]
    assert "said named (seam, air_drag), confidence 0.80" in misses[0]
    assert "no verdict after 600 s" in misses[1]


@pytest.mark.parametrize("tier", ["state", "small"])
def test_an_exam_that_is_finished_is_only_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tier: str
) -> None:
    monkeypatch.setattr(Local, "measure", lambda *_: pytest.fail("judged again"))
    asked, scored = StudyRequest(EXAMS[tier], 7, 3, tmp_path), entries()
    for part, entry in zip(asked.parts(), scored[:3], strict=True):
        outcome = {"values": entry.model_dump(mode="json")}
        facts = {"schema": 1, "key": part.key, "of": part.of, "state": "measured"}
        Journal(asked.journal).put(Record(**facts, outcome=outcome))
    command = f"exam --tier {tier} --cases 3 --seed 7 --out {tmp_path}"
    done = CliRunner().invoke(app, command.split())
    assert done.exit_code == int(tier == "small"), done.output
    assert done.stdout == f"2 of 3 right: {tmp_path / 'exam.md'}\n"
