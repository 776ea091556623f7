"""Runs as CSV tables give the verdict of the run folders that they were made from."""

from pathlib import Path

import numpy as np
import pytest

from policies.experiments.standard import standard_order
from tests.benchmarks.measure_own_runs import OwnRuns, differences
from tests.support.gap_strip_cases import STRIP, folds, written


@pytest.mark.slow
def test_eleven_runs_as_csv_give_the_verdict_of_their_folders(tmp_path: Path) -> None:
    made = folds(
        standard_order(np.random.default_rng(0)), {"bending_hysteresis": {"yield_curvature": 30.0}}
    )
    runs = written(tmp_path / "runs", made)[0].parent
    found = OwnRuns(runs, STRIP, tmp_path).fits(tip=False)
    assert found["folders"].verdict == "named"
    assert not differences(found["folders"], found["csv"])
