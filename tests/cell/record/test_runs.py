import os
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import yaml

import cell
from cell.record.listing import remove, to_prune
from cell.record.writer import RunWriter
from drivers.errors import ConfigurationError
from tests.cell.conftest import HEADER
from tests.support.listed_runs import list_runs

NOW = datetime(2026, 11, 20, 12, 0, 0, tzinfo=UTC)


def lay(root: Path, days_ago: int, result: dict | None = None, header: str | None = None) -> Path:
    moment = (NOW - timedelta(days=days_ago)).strftime("%Y%m%dT%H%M%SZ")
    folder = root / f"{moment}-denim-fold-{days_ago:04x}"
    folder.mkdir(parents=True)
    (folder / "run.yaml").write_text(header or yaml.safe_dump({"schema": 1, **HEADER}))
    (folder / "events.jsonl").write_text("{}\n")
    if result is not None:
        (folder / "result.yaml").write_text(yaml.safe_dump(result))
    return folder


@pytest.fixture
def four(tmp_path):
    lay(tmp_path, 1, {"outcome": "path_done", "duration": 9.0, "displacement": None})
    lay(tmp_path, 2, {"outcome": "layer_touch", "displacement": -0.0363, "duration": 9.4})
    lay(tmp_path, 30)
    lay(tmp_path, 3, {"outcome": "stale_image"}, header="strip: [")
    (tmp_path / "notes").mkdir()
    return tmp_path


def test_runs_are_listed_oldest_first_with_what_they_came_to(four):
    rows = list_runs(four)
    assert [row.outcome for row in rows] == ["died", "broken", "layer_touch", "path_done"]
    touched = rows[2]
    assert (touched.strip, touched.policy, touched.displacement) == ("denim", "triangular", -0.0363)
    assert touched.duration == 9.4
    assert touched.size == sum(p.stat().st_size for p in touched.folder.iterdir())
    assert touched.began == NOW - timedelta(days=2)


def test_finished_run_is_listed(finished):
    (row,) = list_runs(finished.parent)
    assert row.name == finished.name
    assert row.outcome == "layer_touch"


def test_listing_nothing_is_empty_and_a_missing_folder_is_refused(tmp_path):
    assert cell.list_runs(tmp_path) == ()
    with pytest.raises(ConfigurationError, match="is not a folder"):
        cell.list_runs(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("keep", "days", "gone"),
    [(4, None, []), (1, None, [30, 3, 2]), (0, None, [30, 3, 2, 1]), (None, 2.5, [30, 3]),
     (2, 10, [30]), (3, 0.5, [30]), (9, None, [])],
)  # fmt: skip
def test_prune_names_the_oldest_runs(four, keep, days, gone):
    older_than = None if days is None else timedelta(days=days)
    rows = to_prune(list_runs(four), NOW, keep=keep, older_than=older_than)
    assert [(NOW - row.began).days for row in rows] == gone


def test_prune_without_a_rule_or_with_a_senseless_one_is_refused(four):
    with pytest.raises(ConfigurationError, match="--keep, --older-than: give one"):
        to_prune(list_runs(four), NOW)
    with pytest.raises(ConfigurationError, match="keep: is -1"):
        to_prune(list_runs(four), NOW, keep=-1)


def test_choosing_deletes_nothing_and_removing_deletes_just_the_chosen(four):
    chosen = to_prune(list_runs(four), NOW, keep=2)
    assert len(list_runs(four)) == 4
    assert remove(chosen) == sum(row.size for row in chosen)
    assert [row.outcome for row in list_runs(four)] == ["layer_touch", "path_done"]
    assert (four / "notes").is_dir()


def test_run_under_way_is_neither_chosen_nor_removed(tmp_path):
    writer = RunWriter.create(tmp_path, HEADER, "none")
    rows = list_runs(tmp_path)
    assert [row.outcome for row in rows] == ["under way"]
    assert to_prune(rows, NOW, keep=0) == ()
    with pytest.raises(ConfigurationError, match="left alone"):
        remove(rows)
    writer.close()
    assert writer.folder.is_dir()


def test_listing_needs_none_of_the_heavy_libraries():
    code = (
        "import sys, cell.record.listing; "
        "heavy = {'pyarrow', 'cv2', 'rerun', 'torch', 'mujoco', 'numpy'};"
        "sys.exit(', '.join(heavy & set(sys.modules)) or 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=False, capture_output=True, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr
