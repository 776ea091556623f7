"""Measured folds as `cell gap` reads them: whole ones, broken ones, and what is refused."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.runs import read_runs
from cell.gap.subject.strip.subject import open_strip
from tests.support.gap_strip_cases import STRIP, denim, folds, written


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("measured") / "runs"
    written(root, folds(["fast", "taut-lift"]))
    return root


@pytest.fixture
def runs(measured: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(measured, tmp_path / "runs"))


def first(runs: Path) -> Path:
    return sorted(runs.iterdir())[0]


def edit_yaml(path: Path, **changes: object) -> None:
    content = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump(content | changes))


def edit_column(path: Path, name: str, change: Callable[[np.ndarray], np.ndarray]) -> None:
    table = pq.read_table(path)
    values = pa.array(change(np.array(table[name], dtype=np.float64)))
    pq.write_table(table.set_column(table.column_names.index(name), name, values), path)


def drop_column(path: Path, name: str) -> None:
    pq.write_table(pq.read_table(path).drop_columns([name]), path)


def put(row: int, value: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[row] = value
        return values

    return change


def test_what_was_measured_comes_back(runs: Path) -> None:
    fast, taut = (run.measured for run in read_runs(find_runs([runs]), denim()))
    assert fast.touch is not None
    assert fast.end == fast.touch.time
    assert taut.touch is None
    assert len(fast.contact_t) == pytest.approx(30 * fast.end, rel=0.15)
    np.testing.assert_allclose(fast.poses[0, :2], [0.6, 0.0], atol=1e-4)
    assert fast.poses[-1, 2] == pytest.approx(np.pi / 2, abs=1e-6)


def test_a_run_that_died_is_named_and_used(runs: Path) -> None:
    (first(runs) / "result.yaml").unlink()
    strip = open_strip(STRIP, find_runs([runs]))
    assert strip.notes[0].startswith("00-fast: died after")
    died = strip.runs[0].samples
    assert len(died) > 20
    assert "layer_touch" not in died.channel


def test_a_run_that_died_at_once_is_named_and_left_out(runs: Path) -> None:
    shutil.copytree(first(runs), runs / "02-again")
    for name in ("ticks.parquet", "profile.parquet"):
        table = pq.read_table(runs / "02-again" / name)
        pq.write_table(table.slice(0, 9), runs / "02-again" / name)
    (runs / "02-again" / "result.yaml").unlink()
    strip = open_strip(STRIP, find_runs([runs]))
    assert [run.name for run in strip.runs] == ["00-fast", "01-taut-lift"]
    assert strip.notes == ("02-again: has 9 rows only and is left out",)
