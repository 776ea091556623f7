"""A run folder in which something is not as it should be: nobody hangs, the rest is
shown.
"""

import os
import shutil
import warnings
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cell.folding.replay import replay
from cell.record.documents import write_document
from cell.record.files import RECORDING, REPORT
from cell.record.frames import INDEX
from cell.record.listing import list_runs, remove, to_prune
from cell.record.run import read_run
from cell.report.page import write_report
from cell.report.viz.recording import viz_from_run
from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_parquet
from tests.cell.conftest import HEADER, made_run
from tests.support.refusals import refusal
from tests.support.run_edits import edit_column, edit_yaml, put


@pytest.fixture(scope="module")
def whole(calibration, tmp_path_factory) -> Path:
    """A short run with everything in it; not to be changed."""
    return made_run(tmp_path_factory.mktemp("whole"), calibration, 0.6)


@pytest.fixture
def folder(whole, tmp_path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / whole.name))


def document(**changes):
    return lambda path: edit_yaml(path, **changes)


def line(text: str):
    return lambda path: path.write_bytes(text.encode() + b"\n" + path.read_bytes())


def table(change):
    def spoil(path: Path) -> None:
        pq.write_table(change(pq.read_table(path)), path)

    return spoil


def column(name: str, change):
    return lambda path: edit_column(path, name, change)


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def directory(path: Path) -> None:
    path.unlink()
    path.mkdir()


def schema(text: str):
    return table(lambda t: t.replace_schema_metadata({"schema": text}))


SPOILT = {
    "result that is a pipe": ("result.yaml", pipe, "is a pipe"),
    "duration in words": ("result.yaml", document(duration="x"), "duration: "),
    "touch beyond all numbers": ("result.yaml", document(l1=1e300), "l1: "),
    "events in a pipe": ("events.jsonl", pipe, "is a pipe"),
    "index of no place": (
        INDEX,
        line('{"sequence": Infinity, "stamp": 1, "arrival": 2}'),
        INDEX,
    ),
    "ticks that are a folder": (
        "ticks.parquet",
        directory,
        "ticks.parquet",
    ),
    "ticks of another schema": ("ticks.parquet", schema("²"), "schema: is ²"),
    "sight without time": (
        "sights.parquet",
        column("stamp", put(2, np.nan)),
        "stamp: row 2",
    ),
    "camera that stood still": ("ticks.parquet", column("image_age", put(9, 7.5)), ""),
    "profile in mm": (
        "profile.parquet",
        column("x", lambda x: 1e3 * x),
        "give it in m",
    ),
    "ticks without rows": ("ticks.parquet", table(lambda t: t.slice(0, 0)), ""),
    "event nested deep": (
        "events.jsonl",
        line('{"a": ' + "[" * 900 + "]" * 900 + "}"),
        "",
    ),
    "truth that is a list": (
        "truth.yaml",
        lambda path: path.write_text("- 1"),
        "truth.yaml",
    ),
}


@pytest.fixture
def spoilt(folder, name: str) -> str:
    """What is to be said of the run in `folder`, spoilt in the way of that name."""
    file, spoil, says = SPOILT[name]
    (folder / file).touch()
    spoil(folder / file)
    return says


@pytest.mark.parametrize("name", SPOILT)
def test_report_shows_the_good_part_and_names_the_bad_one(folder, spoilt) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        page = write_report(folder).read_text(encoding="utf-8")
    assert ("What could not be read" in page) == bool(spoilt)
    assert spoilt in page
    assert "Made with" in page
    assert [row.strip for row in list_runs(folder.parent)] == ["denim"]


@pytest.mark.parametrize(
    "name", ["events in a pipe", "profile in mm", "index of no place"]
)
def test_recording_shows_the_good_part(folder, spoilt) -> None:
    assert viz_from_run(folder).stat().st_size > 10_000


@pytest.mark.parametrize(
    "name", ["ticks without rows", "sight without time", "index of no place"]
)
def test_replay_refuses_what_it_cannot_decide_on(folder, spoilt) -> None:
    with pytest.raises(ConfigurationError):
        replay(folder)


def test_a_table_that_states_gigabytes_is_not_unpacked(tmp_path) -> None:
    path = tmp_path / "ticks.parquet"
    pq.write_table(pa.table({"t": np.zeros(1_100_000)}), path)
    assert path.stat().st_size < 1_000_000
    with refusal("it states 1100000 rows"):
        read_parquet(path)


def test_a_cells_run_that_died_at_birth_is_explained(tmp_path) -> None:
    folder = tmp_path / "20261120T031500Z-denim-fold-7f3a"
    folder.mkdir()
    write_document(folder / "run.yaml", {"schema": 1, **HEADER, "config": {}})
    assert read_run(folder).died
    assert "died at the start" in write_report(folder).read_text()


def test_report_and_recording_replace_links(finished: Path, tmp_path: Path) -> None:
    linked = Path(shutil.copytree(finished, tmp_path / "run"))
    for name in (REPORT, f"{REPORT}.part", RECORDING):
        (linked / name).unlink(missing_ok=True)
        (linked / name).symlink_to(tmp_path / "outside.txt")
    (tmp_path / "outside.txt").write_text("mine")
    write_report(linked)
    viz_from_run(linked)
    assert (tmp_path / "outside.txt").read_text() == "mine"
    assert not any((linked / name).is_symlink() for name in (REPORT, RECORDING))
    assert (linked / RECORDING).stat().st_size > 1000


def test_linked_run_stays_and_does_not_keep_others(
    finished: Path, tmp_path: Path
) -> None:
    elsewhere = shutil.copytree(finished, tmp_path / "elsewhere" / "run")
    runs = tmp_path / "runs"
    shutil.copytree(finished, runs / "20260101T000000Z-denim-fold-aaaa")
    (runs / "20250101T000000Z-denim-fold-bbbb").symlink_to(elsewhere)
    rows = list_runs(runs)
    assert len(rows) == 2
    gone = to_prune(rows, datetime.now(UTC), keep=0)
    remove(gone)
    assert [path.name for path in runs.iterdir()] == [
        "20250101T000000Z-denim-fold-bbbb"
    ]
    assert (Path(elsewhere) / "run.yaml").exists()
    with refusal("left alone"):
        remove(rows[:1])
