"""Pendulums that were really measured, by people who never heard of this workflow."""

import json
from pathlib import Path

import pytest

from cell.base.config.places import CHECKOUT_CONFIGS
from cell.gap.fit import fit
from tests.support.commands import run
from tests.support.shared import DATA, needs

PENDULUM = DATA / "pendulum"
pytestmark = [pytest.mark.slow, needs(PENDULUM)]
TRIPLE, SINGLE = (
    CHECKOUT_CONFIGS / "mechanisms" / f"{count}-pendulum" / "mechanism.yaml"
    for count in ("triple", "single")
)
FALSE = {"frame_tilt", "wire_spring", "pivot_compliance"}


def test_triple_pendulum_has_air_drag_and_dry_friction(tmp_path: Path) -> None:
    verdict = fit([PENDULUM / "triple" / "runs"], TRIPLE, tmp_path / "out")
    names = [e.name for e in verdict.effects]
    assert (verdict.verdict, sorted(names)) == ("named", ["air_drag", "dry_friction"])
    assert min(verdict.posterior.inclusion[name] for name in names) > 0.999
    assert min(e.confidence for e in verdict.effects) > 0.8
    assert 1.5 < verdict.gap.before["angle_mrad"] < 3.0
    assert verdict.gap.after["angle_mrad"] <= 0.9
    assert verdict.gap.shrink_low > 0.4
    gains = {c.name: c.elpd_gain for c in verdict.candidates}
    for false in (*FALSE, "encoder_bias", "quadratic_damping"):
        assert gains[false] < 0.2 * gains["air_drag"]


def test_single_pendulum_is_fitted_by_coulomb_and_quadratic_losses_and_names_no_other(
    tmp_path: Path,
) -> None:
    verdict = fit([PENDULUM / "single" / "runs"], SINGLE, tmp_path / "out")
    assert FALSE.isdisjoint(e.name for e in verdict.effects)
    pairs = [c for c in verdict.candidates if c.name.count(" + ") == 1]
    best = min(pairs, key=lambda pair: pair.p).name
    assert best in ("air_drag + dry_friction", "dry_friction + quadratic_damping")


def test_a_fit_prints_the_verdict_that_it_wrote(monkeypatch, capsys, tmp_path) -> None:
    single = PENDULUM / "single"
    runs = [single / "runs" / f"{k:02d}" for k in range(4)]
    words = ["gap", "fit", *runs, "--model", SINGLE]
    assert run(monkeypatch, *words, "--out", tmp_path, "--json") == 0
    (printed,) = map(json.loads, capsys.readouterr().out.splitlines())
    assert printed == json.loads((tmp_path / "verdict.json").read_text())
    assert {"report.html", "overlay.rrd"} <= {path.name for path in tmp_path.iterdir()}
