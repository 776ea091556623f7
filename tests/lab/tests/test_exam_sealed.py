"""A diagnosis sees the runs and the strip file, never the key; a case that fails ends
no exam.
"""

from collections import Counter
from pathlib import Path

import pytest

from cell.base.campaign.journal import Record
from cell.base.campaign.progress import Meter
from tests.lab.exam.case import Kind
from tests.lab.exam.diagnosis import FILES, NoVerdict, diagnose, stage
from tests.lab.exam.ledger import read_ledger
from tests.lab.exam.run import LEDGER, run_exam, spread, summarise
from tests.support.exam_cases import case, few_runs
from tests.support.gap_strip_cases import STRIP


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """A staged folder with a file that may be read."""
    folder = tmp_path / "desk"
    folder.mkdir()
    (folder / "strip.yaml").write_text("name: denim", encoding="utf-8")
    return folder


def test_only_the_files_of_the_contract_are_laid_out(
    desk: Path, tmp_path: Path
) -> None:
    run = tmp_path / "runs" / "00-normal"
    run.mkdir(parents=True)
    for name in (*FILES, "truth.yaml", "report.html"):
        (run / name).write_text("x", encoding="utf-8")
    stage(desk, STRIP, [run])
    assert {p.name for p in (desk / "runs" / "00-normal").iterdir()} == set(FILES)


def test_a_process_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    with pytest.raises(NoVerdict, match="no verdict after"):
        diagnose(STRIP, [], tmp_path / "out", limit=0.05)


def test_an_exam_that_ends_early_has_seen_every_kind_in_its_share() -> None:
    kinds: dict[str, Kind] = {"n": "nothing", "s": "single", "p": "pair"}
    drawn = "n" * 8 + "s" * 8 + "p" * 4
    cases = [case(f"{i:02d}", kinds[k], {}) for i, k in enumerate(drawn)]
    order = spread(cases)
    assert sorted(c.name for c in order) == [c.name for c in cases]
    assert Counter(c.kind for c in order[:10]) == {"nothing": 4, "single": 4, "pair": 2}
    for kind in kinds.values():
        own = [c.name for c in order if c.kind == kind]
        assert own == sorted(own)


@pytest.mark.slow
def test_a_case_that_fails_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    cases = [case("bad", "nothing", {}, seed=13), case("good", "nothing", {})]
    seen = Seen()
    run_exam(cases, tmp_path, judged=False, make=few_runs, meter=seen)
    assert any("bad: failed: unexpected RuntimeError" in line for line in seen.lines)
    assert "good: runs made" in seen.lines
    assert [e.state for e in read_ledger(tmp_path / LEDGER).values()] == ["failed"]


class Seen(Meter):
    """A meter that notes what came of each case."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def finish(self, cost: float, record: Record) -> None:
        self.lines.append(record.key + summarise(record))
