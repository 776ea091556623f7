"""A campaign measures every part once, keeps it, and goes on wherever it stopped."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cell.base.campaign.journal import Journal, Record
from cell.base.campaign.progress import Meter
from cell.base.campaign.run import Local, carry_out
from tests.support.campaign_parts import Broken, Deadly, Endless, Fine, Impossible
from tests.support.refusals import refusal

ROOT = Path(__file__).parents[4]


def run(parts, folder: Path, jobs: int = 1, limit: float | None = None, **asked):
    found = carry_out(parts, folder, Local(jobs, limit), Meter(), **asked)
    return {record.key: record for record in found}


def record(key: str, of: str = "first", **facts) -> Record:
    return Record(
        schema=1, key=key, of=of, state="measured", **{"outcome": {"d": 0.1}, **facts}
    )


@pytest.mark.slow
def test_parts_that_fail_die_or_never_end_leave_the_others_measured(
    tmp_path: Path,
) -> None:
    parts = [
        Fine("a"),
        Impossible("b"),
        Deadly("c"),
        Broken("d"),
        Endless("e"),
        Fine("f"),
    ]
    found = run(parts, tmp_path, jobs=2, limit=6.0)
    assert {key: record.state for key, record in found.items()} == {
        "a": "measured",
        "b": "failed",
        "c": "set_aside",
        "d": "failed",
        "e": "set_aside",
        "f": "measured",
    }
    assert found["b"].reason == "this strip cannot be folded"
    assert found["c"].reason == "its process died 2 times: it ended by itself, code 3"
    assert "ZeroDivisionError" in found["d"].reason
    assert found["e"].reason == "no outcome after 6 s; its process was ended"


def test_journals_merge_by_copying(tmp_path: Path) -> None:
    keys = [f"part {number}" for number in range(10)]
    whole = Journal(tmp_path / "whole")
    for key in keys:
        whole.put(record(key))
    for number in (1, 2, 3):
        journal = Journal(tmp_path / str(number))
        for key in keys[number - 1 :: 3]:
            journal.put(record(key))
        shutil.copytree(journal.folder, tmp_path / "merged", dirs_exist_ok=True)
    assert Journal(tmp_path / "merged").records() == whole.records()


def test_a_file_that_is_broken_or_of_a_newer_schema_is_no_record(
    tmp_path: Path,
) -> None:
    journal = Journal(tmp_path)
    journal.put(record("a"))
    path = journal.path("a", "first")
    whole = json.loads(path.read_text())
    for content in ("", path.read_text()[:-9], json.dumps(whole | {"schema": 2})):
        path.write_text(content)
        assert journal.get("a", "first") is None
        assert journal.records() == ()
    path.write_text(json.dumps(whole | {"colour": "blue"}))
    assert journal.get("a", "first") == record("a")


def test_a_folder_that_cannot_be_written_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with refusal(r"--out: .*cannot be written"):
        run([Fine("a")], tmp_path / "file" / "journal")


KILLED = """
import sys
from pathlib import Path
from cell.base.campaign.progress import Meter
from cell.base.campaign.run import Local, carry_out
from tests.support.campaign_parts import Fine
marks = Path(sys.argv[1])
parts = [Fine(f"part {n}", marks, seconds=0.05) for n in range(40)]
for _ in carry_out(parts, Path(sys.argv[2]), Local(2), Meter()):
    pass
"""


@pytest.mark.slow
def test_killed_at_any_moment_it_goes_on_and_ends_with_the_same_records(
    tmp_path: Path,
) -> None:
    marks, folder = tmp_path / "marks", tmp_path / "j"
    command = [sys.executable, "-c", KILLED, str(marks), str(folder)]
    kills = 0
    for after in (0.1, 1.0, 1.4):
        with subprocess.Popen(command, cwd=ROOT, start_new_session=True) as process:
            before = len(Journal(folder).records())
            while (
                process.poll() is None and len(Journal(folder).records()) < before + 3
            ):
                time.sleep(0.01)
            time.sleep(0.01 * after)
            kills += process.poll() is None
            os.killpg(process.pid, signal.SIGKILL)
    subprocess.run(command, cwd=ROOT, check=True)
    assert kills == 3
    assert len(Journal(folder).records()) == 40
    measured = marks.read_text().split("\n")[:-1]
    assert len(set(measured)) == 40
    assert len(measured) <= 40 + 2 * kills  # what was under way when it was killed
    alone = run([Fine(f"part {n}") for n in range(40)], tmp_path / "alone", jobs=2)
    for found in Journal(folder).records():
        assert found.outcome == alone[found.key].outcome
