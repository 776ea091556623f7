"""The report of an exam: what the ledger holds, in words that a technician reads."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cell.gap.verdict.schema import Verdict
from drivers.errors import ConfigurationError
from tests.lab.__main__ import app
from tests.lab.exam import cases as drawing
from tests.lab.exam.case import Case
from tests.lab.exam.cases import DRAWN_FILE, KEYS_FOLDER, Sources, case_hash, load_or_draw
from tests.lab.exam.ledger import Entry, Ledger
from tests.lab.exam.page import markdown, write_report
from tests.lab.exam.run import LEDGER, ExamPart
from tests.lab.exam.score import Baselines, Oracle, score
from tests.lab.exam.targets import targets
from tests.support.exam_cases import case, named, verdict
from tests.support.gap_strip_cases import denim


def scored(hidden: Case, said: Verdict, known: float = 1.0) -> Entry:
    return Entry(
        case=hidden, of="engine-case-scorer", state="scored",
        outcome=score(said, hidden, denim()),
        oracle=Oracle(after=0.0, shrink=known) if hidden.answer else None,
        baselines=Baselines(single="seam", right="seam" in hidden.answer),
        wall=30.0, memory=600.0,
    )  # fmt: skip


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
    lost = Entry(case=right.case, of="x", state="failed", reason="its process died")
    assert met([right], "strictly") is True
    assert met([right, lost], "strictly") is False


def test_few_cases_without_an_alarm_do_not_show_that_there_are_few() -> None:
    quiet = [scored(case(f"n{i}", "nothing", {}), verdict("no_gap")) for i in range(100)]
    assert met(quiet[:20], "an effect named where nothing", "state") is False
    assert met(quiet, "an effect named where nothing", "state") is True
    assert met(quiet[:20], "an effect named where nothing") is True


def test_six_cases_of_six_are_no_miss_where_a_single_one_decides() -> None:
    quiet = [scored(case(f"n{i}", "nothing", {}), verdict("no_gap")) for i in range(6)]
    rows = [line for line in markdown(quiet).splitlines() if "where nothing is hidden" in line]
    assert any("too few cases" in row for row in rows)
    assert not any("missed" in row for row in rows)
    alarms = [scored(case(f"n{i}", "nothing", {}), named("seam")) for i in range(60)]
    assert markdown(alarms).count("**missed**") >= 2


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
        scored(case("air", "outside", {}, causes={"draught": {"speed": 0.3}}, tier="images"),
               verdict("unexplained")),
        Entry(case=lost, of="engine-case-scorer", state="failed", reason="no verdict after 600 s"),
    ]  # fmt: skip


def test_the_page_lists_every_miss_and_nothing_else_as_one() -> None:
    page = markdown(entries())
    misses = [line for line in page.splitlines() if line.startswith("- `")]
    assert [line.split("`")[1] for line in misses] == ["fooled", "lost"]
    assert "desk_tilt (angle 0.01)" in misses[0]
    assert "said named (seam, air_drag), confidence 0.80" in misses[0]
    assert "no verdict after 600 s" in misses[1]


def test_the_report_has_a_figure_for_each_tier(tmp_path: Path) -> None:
    written = write_report(entries(), tmp_path / "exam.md", "python -m tests.lab exam")
    assert {p.name for p in written} == {"exam.md", "exam-state.png", "exam-images.png"}
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in written[1:])
    page = written[0].read_text(encoding="utf-8")
    assert all(p.name in page for p in written[1:])


def by_these_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    """Entries were made by the sources of today, and whoever makes one again fails."""
    monkeypatch.setattr(Sources, "entry", lambda *_: "engine-case-scorer")
    monkeypatch.setattr(ExamPart, "measure", lambda _: pytest.fail("judged again"))


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """An exam of two cases that were drawn and scored."""
    every = entries()[:2]
    asked = {"tier": "state", "count": 2, "seed": 7}
    (tmp_path / KEYS_FOLDER).mkdir()
    cases = {"cases": [e.case.model_dump(mode="json") for e in every]}
    (tmp_path / KEYS_FOLDER / DRAWN_FILE).write_text(json.dumps(asked | cases), encoding="utf-8")
    ledger = Ledger(tmp_path / LEDGER)
    for entry in every:
        ledger.put(entry)
    return tmp_path


def test_cases_are_drawn_once(kept: Path) -> None:
    assert load_or_draw(kept, "state", 2, 7) == tuple(e.case for e in entries()[:2])


def test_a_folder_of_another_exam_is_refused(kept: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"holds another exam \(tier state count 2 seed 7"):
        load_or_draw(kept, "state", 2, 8)


def test_a_case_without_force_says_nothing_of_it() -> None:
    case = entries()[0].case
    assert "force" not in case.model_dump()
    feeling = case.model_copy(update={"force": 0.005})
    assert case_hash(feeling) != case_hash(case)


def test_an_exam_of_one_kind_is_another_one_and_outside_needs_images(kept: Path) -> None:
    with pytest.raises(ConfigurationError, match="holds another exam"):
        load_or_draw(kept, "state", 2, 7, kind="single")
    with pytest.raises(ConfigurationError, match="--tier images"):
        load_or_draw(kept, "state", 2, 7, kind="outside")


def test_the_digest_of_a_case_depends_on_the_runs_made(monkeypatch: pytest.MonkeyPatch) -> None:
    once = entries()[0].case
    before = case_hash(once)
    for other in ({"repeats": 2}, {"motions": "by_hand"}):
        assert case_hash(once.model_copy(update=other)) != before
    monkeypatch.setattr(drawing, "MOTIONS", ("normal", "fast"))
    assert case_hash(once) != before


def test_an_exam_that_is_finished_is_only_reported(
    kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_these_sources(monkeypatch)
    asked = ["exam", "--tier", "state", "--cases", "2", "--seed", "7", "--out", str(kept)]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    assert done.stdout == f"2 of 2 right: {kept / 'exam.md'}\n"
    assert (kept / "exam-state.png").is_file()


def test_an_exam_goes_on_by_the_ledger_that_it_is_given(
    kept: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_these_sources(monkeypatch)
    ledger = tmp_path_factory.mktemp("elsewhere") / "state-7.jsonl"
    (kept / LEDGER).rename(ledger)
    asked = ["exam", "--tier", "state", "--cases", "2", "--seed", "7", "--out", str(kept)]
    done = CliRunner().invoke(app, [*asked, "--ledger", str(ledger)])
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("2 of 2 right")
    assert not (kept / LEDGER).exists()


def test_steps_that_exclude_each_other_are_refused(tmp_path: Path) -> None:
    asked = ["exam", "--out", str(tmp_path), "--only-make", "--only-judge"]
    done = CliRunner().invoke(app, asked)
    assert isinstance(done.exception, ConfigurationError)
