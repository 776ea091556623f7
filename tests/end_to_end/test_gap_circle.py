"""The circle closes: a strip that folds badly is explored, its model mended, and it folds well."""

from pathlib import Path

import numpy as np
import pytest

from cell.gap.verdict.schema import Verdict
from tests.benchmarks.measure_circle import AFTER, BEFORE, Circle, Effects, begin, millimetres

pytestmark = pytest.mark.slow

YARNS = Path("configs/plants/denim.yaml")
TOOL: Effects = {"tcp_offset": {"x": 0.0, "z": -0.008}}  # m, the tool is longer than stated
REPEAT = 2


def closed(circle: Circle) -> tuple[np.ndarray, Verdict, np.ndarray]:
    """Displacements (n, 2) [mm] before, what was named, displacements after, on new seeds."""
    before = millimetres(circle.fold("before", BEFORE, REPEAT))
    verdict = circle.learn()
    return before, verdict, millimetres(circle.fold("after", AFTER, REPEAT))


def test_friction_of_denim_is_learned_and_the_planned_fold_lies_even(tmp_path: Path) -> None:
    before, verdict, after = closed(begin("denim", YARNS, tmp_path))
    assert "bending_hysteresis" in {effect.name for effect in verdict.effects}
    assert np.abs(before).min() > 10.0
    assert np.abs(after).max() < 5.0


def test_tool_longer_than_stated_is_learned_and_the_arm_makes_up_for_it(tmp_path: Path) -> None:
    circle = begin("denim", TOOL, tmp_path)
    before, verdict, after = closed(circle)
    assert [effect.name for effect in verdict.effects] == ["tcp_offset"]
    assert "tcp_offset" in (circle.configs / "cell.yaml").read_text(encoding="utf-8")
    seen, true = np.abs(before.T)
    assert true.min() > 6.0
    assert seen.max() < 4.0  # the camera trusts the arm, and is deceived with it
    assert np.abs(after).max() < 3.0
