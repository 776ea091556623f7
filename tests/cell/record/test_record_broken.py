"""Run folders that broke off early, or were changed by hand."""

import errno
import os
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from cell.record.documents import write_document
from cell.record.files import SIGHT_STREAM
from cell.record.frames import INDEX, read_index
from cell.record.listing import list_runs
from cell.record.run import read_run
from cell.record.stream import SIGHT_ROWS, read_stream
from cell.record.writer import RunWriter
from cell.report.page import write_report
from cell.report.viz.recording import viz_from_run
from drivers.errors import ConfigurationError
from drivers.files import replace_file
from drivers.readers import read_parquet
from tests.cell.conftest import HEADER


def test_what_is_learned_in_a_run_is_on_disk_once_it_has_ended(tmp_path) -> None:
    writer = RunWriter.create(tmp_path, HEADER, "none")
    before = (writer.folder / "run.yaml").read_bytes()
    writer.describe(preflight=[{"name": "contrast", "passed": True}])
    assert (writer.folder / "run.yaml").read_bytes() == before  # a tick waits for no disk
    writer.close()
    header = yaml.safe_load((writer.folder / "run.yaml").read_text())
    assert header["preflight"] == [{"name": "contrast", "passed": True}]
    assert {key: header[key] for key in HEADER} == HEADER


def test_a_cells_run_that_died_at_birth_is_explained(tmp_path) -> None:
    folder = tmp_path / "20261120T031500Z-denim-fold-7f3a"
    folder.mkdir()
    write_document(folder / "run.yaml", {"schema": 1, **HEADER, "config": {}})
    assert read_run(folder).died
    assert "died at the start" in write_report(folder).read_text()


def test_a_laboratorys_run_without_its_tables_is_refused(tmp_path) -> None:
    write_document(tmp_path / "run.yaml", {"schema": 1, **HEADER})
    with pytest.raises(ConfigurationError, match=r"ticks\.parquet: is missing"):
        read_run(tmp_path)


def test_a_document_that_the_disk_refuses_leaves_nothing(tmp_path, monkeypatch) -> None:
    path = tmp_path / "result.yaml"
    path.write_text("old")

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        replace_file(path, b"new")
    assert [entry.name for entry in tmp_path.iterdir()] == ["result.yaml"]
    assert path.read_text() == "old"


def test_columns_whose_names_are_no_text_are_refused_in_one_line(tmp_path) -> None:
    empty = pa.Table.from_batches([], SIGHT_ROWS)
    written = pa.BufferOutputStream()
    with pa.ipc.new_stream(written, SIGHT_ROWS) as stream:
        stream.write_table(empty)
    path = tmp_path / SIGHT_STREAM
    path.write_bytes(written.getvalue().to_pybytes().replace(b"profile_z", b"pro\xcfile_z"))
    with pytest.raises(ConfigurationError, match=r"no text"):
        read_stream(path, SIGHT_ROWS)
    packed = tmp_path / "sights.parquet"
    pq.write_table(empty, packed, store_schema=False)
    packed.write_bytes(packed.read_bytes().replace(b"profile_z", b"pro\xcfile_z"))
    with pytest.raises(ConfigurationError, match=r"not a whole Parquet file"):
        read_parquet(packed)


@pytest.mark.parametrize("line", ['{"stamp": 1.0}', '{"sequence": "x", "stamp": 1, "arrival": 2}'])
def test_an_index_of_images_that_was_changed_is_refused_in_one_line(tmp_path, line) -> None:
    (tmp_path / "frames").mkdir()
    (tmp_path / INDEX).write_text(line + "\n")
    with pytest.raises(ConfigurationError, match=r"index\.jsonl"):
        read_index(tmp_path)


def test_an_event_without_a_time_does_not_hide_the_others(finished, tmp_path) -> None:
    copy = Path(shutil.copytree(finished, tmp_path / "run"))
    with (copy / "events.jsonl").open("a") as file:
        file.write('{"t": "noon", "kind": "lunch"}\n{"kind": "nap"}\n{"t": 9, "kind": "end"}\n')
    assert [event.kind for event in read_run(copy).events()][-3:] == ["lunch", "nap", "end"]


def test_a_run_under_way_writes_its_own_recording(tmp_path) -> None:
    writer = RunWriter.create(tmp_path, HEADER, "none")
    with pytest.raises(ConfigurationError, match="still under way"):
        viz_from_run(writer.folder)
    writer.close()


def test_a_folder_named_by_no_moment_is_listed_all_the_same(finished, tmp_path) -> None:
    shutil.copytree(finished, tmp_path / "99999999T999999Z-denim")
    assert [row.name for row in list_runs(tmp_path)] == ["99999999T999999Z-denim"]
