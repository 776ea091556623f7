"""A run's folder that holds links changes nothing outside of it, and may stay among others."""

import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest

from cell.record.files import REBUILT, RECORDING, REPORT, is_under_way
from cell.record.listing import list_runs, remove, to_prune
from cell.record.writer import RunWriter
from cell.report.page import write_report
from cell.report.viz.recording import viz_from_run
from drivers.errors import ConfigurationError
from tests.cell.conftest import HEADER


@pytest.fixture
def linked(finished: Path, tmp_path: Path) -> Path:
    """A run whose report and recording, and what they were made by, lead elsewhere."""
    run = Path(shutil.copytree(finished, tmp_path / "run"))
    for name in (REPORT, f"{REPORT}.part", REBUILT):
        (run / name).unlink(missing_ok=True)
        (run / name).symlink_to(tmp_path / "outside.txt")
    (run / RECORDING).write_bytes(b"kept")
    (tmp_path / "outside.txt").write_text("mine")
    return run


def test_report_and_recording_replace_links(linked: Path) -> None:
    write_report(linked)
    viz_from_run(linked)
    assert (linked.parent / "outside.txt").read_text() == "mine"
    assert not (linked / REPORT).is_symlink()
    assert not (linked / REBUILT).is_symlink()
    assert (linked / REBUILT).stat().st_size > 1000
    assert (linked / RECORDING).read_bytes() == b"kept"


def test_linked_run_stays_and_does_not_keep_others(finished: Path, tmp_path: Path) -> None:
    elsewhere = shutil.copytree(finished, tmp_path / "elsewhere" / "run")
    runs = tmp_path / "runs"
    shutil.copytree(finished, runs / "20260101T000000Z-denim-fold-aaaa")
    (runs / "20250101T000000Z-denim-fold-bbbb").symlink_to(elsewhere)
    rows = list_runs(runs)
    assert len(rows) == 2
    gone = to_prune(rows, datetime.now(UTC), keep=0)
    remove(gone)
    assert [path.name for path in runs.iterdir()] == ["20250101T000000Z-denim-fold-bbbb"]
    assert (Path(elsewhere) / "run.yaml").exists()
    with pytest.raises(ConfigurationError, match="left alone"):
        remove(rows[:1])


def test_run_is_under_way_until_all_is_in_its_folder(tmp_path: Path) -> None:
    writer = RunWriter.create(tmp_path, HEADER, "none")
    with writer.under_way():
        writer.finish({"outcome": "path_done"})
        writer.close()
        assert is_under_way(writer.folder)
        assert "Still under way" not in write_report(writer.folder, ended=True).read_text()
        assert to_prune(list_runs(tmp_path), datetime.now(UTC), keep=0) == ()
    assert not is_under_way(writer.folder)
