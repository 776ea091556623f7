"""A diagnosis sees the runs and the strip file, never the key; one without a verdict
ends no exam.
"""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tests.lab.exam.run import KINDS, NoVerdict, diagnose, draw, judge
from tests.support.exam_cases import case, few_runs


def test_a_process_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    with pytest.raises(NoVerdict, match="no verdict after"):
        diagnose(tmp_path, limit=0.05)


def test_an_exam_that_ends_early_has_seen_every_kind_and_counts_each() -> None:
    rng = np.random.default_rng(0)
    for tier, kinds in KINDS.items():
        drawn = [draw(i, rng, tier) for i in range(20)]
        assert len({values["kind"] for values in drawn[:8]}) == len(set(kinds))
        for kind, count in Counter(kinds).items():
            numbers = [each["number"] for each in drawn if each["kind"] == kind]
            assert numbers == list(range(2 * count))


@pytest.mark.slow
def test_runs_are_judged_by_the_command_and_a_refusal_is_an_entry(
    tmp_path: Path,
) -> None:
    hidden = case("tilt", "single", {"desk_tilt": {"angle": 0.02}})
    few_runs(hidden, tmp_path / "runs")
    judged = judge(hidden, tmp_path)
    assert judged["outcome"]["verdict"] == "named"
    assert judged["plant"] == "the model itself"
    for ticks in (tmp_path / "runs").glob("*/ticks.parquet"):
        ticks.unlink()
    refused = judge(hidden, tmp_path)
    assert refused["outcome"] is None
    assert "the workflow ended with code 2" in refused["reason"]
