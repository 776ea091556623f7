"""The whole workflow on folds of a strip: a hidden effect is named, patched in, and gone."""

from pathlib import Path

import pytest

from cell.gap.fit import fit
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.subject import open_strip
from cell.gap.verdict.schema import Verdict
from drivers.strip.describe import load_strip
from tests.support.gap_strip_cases import STRIP, folds, written

pytestmark = pytest.mark.long

NAMES = ("normal", "slow-low", "there-and-back", "fast", "shake", "normal")
YIELD = 10.0  # 1/m


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Verdict, Path, Path]:
    """The verdict on folds of a strip whose yarns rub, where it lies, and the folds."""
    root = tmp_path_factory.mktemp("rubbing")
    yarns = {"bending_hysteresis": {"yield_curvature": YIELD}}
    written(root / "runs", folds(NAMES, yarns, retardation_time=0.05))
    verdict = fit([root / "runs"], STRIP, root / "out", jobs=2)
    return verdict, root / "out", root / "runs"


def test_friction_between_yarns_is_named_with_its_size(fitted: tuple[Verdict, Path, Path]) -> None:
    verdict, _, _ = fitted
    assert verdict.verdict == "named"
    assert [effect.name for effect in verdict.effects] == ["bending_hysteresis"]
    found = verdict.effects[0].parameters["yield_curvature"]
    assert found.value == pytest.approx(YIELD, rel=0.2)
    assert verdict.gap.shrink > 0.6


def test_gaps_are_told_in_the_words_of_a_strip(fitted: tuple[Verdict, Path, Path]) -> None:
    verdict, _, _ = fitted
    keys = {"profile_mm", "contact_x_mm", "displacement_mm", "touch_ms", "excess"}
    assert keys <= set(verdict.gap.before)
    assert {place.channel for place in verdict.where} <= {"profile", "contact_x", "layer_touch"}
    assert any(place.phase == "return" for place in verdict.where)


def test_the_patch_is_a_strip_that_explains_its_runs(fitted: tuple[Verdict, Path, Path]) -> None:
    _, out, runs = fitted
    patched = load_strip(out / "patch.yaml")
    assert set(patched.effects) == {"bending_hysteresis"}
    notes = {p.key for p in patched.provenance}
    assert {"bending_length", "retardation_time", "effects.bending_hysteresis"} <= notes
    strip = open_strip(out / "patch.yaml", find_runs([runs]))
    assert "bending_hysteresis" not in {c.name for c in strip.scope.candidates}
    assert "bending_hysteresis.yield_curvature" in {p.name for p in strip.scope.base}
