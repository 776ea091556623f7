"""Pendulums that were really measured, by people who never heard of this workflow."""

from pathlib import Path
from typing import Any

import pytest

from cell.gap.fit import fit, open_subject
from cell.gap.folders import find_runs

DATA = Path(__file__).parents[2] / "shared" / "data" / "pendulum"
real = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured pendulums in {DATA}")
FALSE = ("frame_tilt", "encoder_bias", "wire_spring", "pivot_compliance", "quadratic_damping")


def check_triple(verdict: Any) -> None:
    assert verdict.verdict == "named"
    assert sorted(e.name for e in verdict.effects) == ["air_drag", "dry_friction"]
    assert 1.5 < verdict.gap.before["angle_mrad"] < 3.0
    assert verdict.gap.after["angle_mrad"] <= 0.9
    assert verdict.gap.shrink_low > 0.4
    (drag,) = (c for c in verdict.candidates if c.name == "air_drag")
    for single in (c for c in verdict.candidates if c.name in FALSE):
        assert single.elpd_gain < 0.2 * drag.elpd_gain


@real
def test_triple_pendulum_has_air_drag_and_dry_friction(tmp_path: Path) -> None:
    runs = [DATA / "triple" / "runs" / f"{k:02d}" for k in (0, 4, 8, 12, 16, 20, 24)]
    check_triple(fit(runs, DATA / "triple" / "pendulum.yaml", tmp_path / "out"))


@real
@pytest.mark.slow
def test_whole_triple_pendulum_has_air_drag_and_dry_friction(tmp_path: Path) -> None:
    triple = DATA / "triple"
    check_triple(fit([triple / "runs"], triple / "pendulum.yaml", tmp_path / "out"))


@real
@pytest.mark.slow
def test_single_pendulum_is_fitted_by_coulomb_and_quadratic_losses_and_names_no_other(
    tmp_path: Path,
) -> None:
    single = DATA / "single"
    verdict = fit([single / "runs"], single / "pendulum.yaml", tmp_path / "out")
    assert not {e.name for e in verdict.effects} & {"frame_tilt", "wire_spring", "pivot_compliance"}
    pairs = {c.name: c.p for c in verdict.candidates if " + " in c.name}
    best = min(pairs, key=lambda name: pairs[name])
    assert best in ("air_drag + dry_friction", "dry_friction + quadratic_damping")


@real
def test_measured_swings_are_read_whole() -> None:
    subject = open_subject(
        DATA / "triple" / "pendulum.yaml", find_runs([DATA / "triple" / "runs"]), 1
    )
    assert len(subject.runs) == 26
    assert [run.index for run in subject.runs] == list(range(26))
