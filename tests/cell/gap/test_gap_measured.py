"""Pendulums that were really measured, by people who never heard of this workflow."""

import json
from pathlib import Path

import pytest

from cell.base.config.places import CHECKOUT_CONFIGS
from cell.gap.fit import fit
from tests.support.commands import run

DATA = Path(__file__).parents[4] / "shared" / "data" / "pendulum"
real = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured pendulums in {DATA}")
TRIPLE, SINGLE = (
    CHECKOUT_CONFIGS / "mechanisms" / f"{count}-pendulum" / "mechanism.yaml"
    for count in ("triple", "single")
)
FALSE = (
    "frame_tilt",
    "encoder_bias",
    "wire_spring",
    "pivot_compliance",
    "quadratic_damping",
)


@real
@pytest.mark.slow
def test_triple_pendulum_has_air_drag_and_dry_friction(tmp_path: Path) -> None:
    verdict = fit([DATA / "triple" / "runs"], TRIPLE, tmp_path / "out")
    found = [
        (e.name, verdict.posterior.inclusion[e.name] > 0.999) for e in verdict.effects
    ]
    assert (verdict.verdict, dict(found)) == (
        "named",
        {"air_drag": True, "dry_friction": True},
    )
    assert min(e.confidence for e in verdict.effects) > 0.8
    assert 1.5 < verdict.gap.before["angle_mrad"] < 3.0
    assert verdict.gap.after["angle_mrad"] <= 0.9
    assert verdict.gap.shrink_low > 0.4
    (drag,) = (c for c in verdict.candidates if c.name == "air_drag")
    for single in (c for c in verdict.candidates if c.name in FALSE):
        assert single.elpd_gain < 0.2 * drag.elpd_gain


@real
@pytest.mark.slow
def test_single_pendulum_is_fitted_by_coulomb_and_quadratic_losses_and_names_no_other(
    tmp_path: Path,
) -> None:
    verdict = fit([DATA / "single" / "runs"], SINGLE, tmp_path / "out")
    assert not {e.name for e in verdict.effects} & {
        "frame_tilt",
        "wire_spring",
        "pivot_compliance",
    }
    pairs = {c.name: c.p for c in verdict.candidates if c.name.count(" + ") == 1}
    best = min(pairs, key=lambda name: pairs[name])
    assert best in ("air_drag + dry_friction", "dry_friction + quadratic_damping")


@real
@pytest.mark.slow
def test_a_fit_prints_the_verdict_that_it_wrote(monkeypatch, capsys, tmp_path) -> None:
    single = DATA / "single"
    runs = [single / "runs" / f"{k:02d}" for k in range(4)]
    words = ["gap", "fit", *runs, "--model", SINGLE]
    assert run(monkeypatch, *words, "--out", tmp_path, "--json") == 0
    (printed,) = map(json.loads, capsys.readouterr().out.splitlines())
    assert printed == json.loads((tmp_path / "verdict.json").read_text())
    assert {"report.html", "overlay.rrd"} <= {path.name for path in tmp_path.iterdir()}
