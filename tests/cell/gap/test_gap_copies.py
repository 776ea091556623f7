"""Copies of one run are recognised by what was measured, counted once, and said."""

import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cell.gap.fit import FitOptions, fit
from cell.gap.subject.run_folders import find_runs, without_copies
from tests.support.mechanisms import make_arm, write_run
from tests.support.run_edits import edit_column


def a_run(folder: Path, seed: int, **changes: object) -> Path:
    """Table of a run folder of any kind with numbers of its own."""
    x = np.random.default_rng(seed).normal(size=50)
    x[::7] = np.nan
    columns, head = {"t": np.arange(50.0), "x": x}, {"strip": "denim", **changes}
    write_run(folder, columns, head, "ticks.parquet")
    return folder / "ticks.parquet"


def test_copies_count_once_however_written_and_runs_with_another_number_all(
    tmp_path,
) -> None:
    a_run(tmp_path / "a", 1)
    a_run(tmp_path / "b", 2)
    copy = a_run(tmp_path / "c", 1, index=7, condition="other")
    copy.with_name("result.yaml").write_text("schema: 1\n")
    turned = a_run(tmp_path / "d", 1)
    table = pq.read_table(turned).select(["x", "t"])
    pq.write_table(table, turned, compression="NONE")
    edit_column(a_run(tmp_path / "e", 1), "x", lambda x: np.round(x, 5))
    edit_column(a_run(tmp_path / "f", 1), "x", lambda x: x + 1e-4 * (x == x[3]))
    kept, copies = without_copies(find_runs([tmp_path]))
    assert [run.name for run in kept] == ["a", "b", "f"]
    assert copies == dict.fromkeys("cde", "a")


def test_a_copy_that_is_to_be_held_out_is_the_run_that_it_copies(
    tmp_path, monkeypatch
) -> None:
    file, runs = make_arm(tmp_path, 2, span=1.0)
    shutil.copytree(runs / "01", runs / "copy")
    asked: list[object] = []

    def held_out(*given: object) -> None:
        asked.extend(given)
        raise KeyboardInterrupt

    monkeypatch.setattr("cell.gap.selection.hold_out.held_out", held_out)
    with pytest.raises(KeyboardInterrupt):
        fit([runs], file, tmp_path / "out", FitOptions(["copy"]))
    assert asked[-1] == ["01"]
