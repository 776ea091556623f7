"""The interface of Python: tables, figures and the numbers that matter at a glance."""

import dataclasses
import subprocess
import sys
from unittest.mock import Mock

import pyarrow as pa
import pytest

import cell
from cell.record import columns

FIRST_TOUCH = """
import time
import cell
cell.list_runs
print(time.process_time())
"""


def test_runs_are_a_table_of_one_row_each(finished) -> None:
    table = cell.runs(finished.parent)
    assert table.num_rows == len(cell.list_runs(finished.parent))
    assert table["displacement"].to_pylist() == [pytest.approx(-0.0363)]


def test_a_listed_run_is_a_record_of_named_values_and_no_list_of_pairs(
    finished,
) -> None:
    (row,) = cell.list_runs(finished.parent)
    assert dataclasses.is_dataclass(row)
    assert dataclasses.asdict(row)["strip"] == "denim"
    with pytest.raises(TypeError, match="iterable"):
        iter(row)


def test_ticks_are_a_frame_where_pandas_is_installed_and_else_a_table(
    finished, monkeypatch
) -> None:
    ticks = cell.read_run(finished).ticks
    assert pa.table(ticks).column_names == ticks.frame().column_names
    monkeypatch.setattr(columns, "find_spec", lambda name: name)
    assert columns.as_frame(Mock(to_pandas=lambda: "frame")) == "frame"


def test_a_run_says_its_numbers_and_draws_itself(finished) -> None:
    run = cell.read_run(finished)
    assert repr(run).endswith("layer touch, displacement -36.3 mm, edges -31.0 mm")
    assert run.plot()._repr_png_().startswith(b"\x89PNG")
    assert run.plot().axes[0].get_ylabel() == "z  [mm]"


def test_first_touch_of_a_function_takes_no_more_than_two_seconds() -> None:
    done = subprocess.run(
        [sys.executable, "-c", FIRST_TOUCH], capture_output=True, text=True, check=True
    )
    assert float(done.stdout) < 2.0


def test_version_is_that_of_the_package() -> None:
    assert cell.__version__.count(".") == 2
