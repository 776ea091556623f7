"""Copies of one run are recognised by what was measured, counted once, and said."""

import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cell.base.config.places import CHECKOUT_CONFIGS
from cell.gap.fit import FitOptions, fit
from cell.gap.subject.run_folders import find_runs, without_copies
from tests.support.mechanisms import write_run
from tests.support.run_edits import edit_column

FILE = CHECKOUT_CONFIGS / "mechanisms" / "single-pendulum" / "mechanism.yaml"
SINGLE = Path(__file__).resolve().parents[4] / "shared" / "data" / "pendulum" / "single"


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


@pytest.mark.long
@pytest.mark.skipif(not SINGLE.is_dir(), reason="the measured pendulums are absent")
def test_a_fit_counts_copies_once_and_says_so(tmp_path) -> None:
    runs = tmp_path / "runs"
    for k in range(3):
        shutil.copytree(SINGLE / "runs" / f"{k:02d}", runs / f"{k:02d}")
    plain = fit([runs], FILE, tmp_path / "one", FitOptions(["01"]))
    for k in range(2):
        shutil.copytree(runs / "01", runs / f"copy-{k}")
    verdict = fit([runs], FILE, tmp_path / "copied", FitOptions(["copy-1"]))
    assert verdict.held_out == ["01"]
    assert verdict.base == plain.base
    assert len(verdict.notes) == 2
    assert "copy-0: holds the measurements of 01" in verdict.notes[0]
    assert "copy-0: holds" in (tmp_path / "copied" / "report.html").read_text()
