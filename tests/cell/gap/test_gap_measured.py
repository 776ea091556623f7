"""Pendulums that were really measured, by people who never heard of this workflow."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cell.gap.diagnosis.held_out_gap import rms, unseen
from cell.gap.fit import fit
from cell.gap.fitting.gauss_newton import refit
from cell.gap.fitting.model import Model, Point, evidence
from cell.gap.fitting.tasks import run_one
from cell.gap.opening import open_subject
from cell.gap.subject.run_folders import find_runs

DATA = Path(__file__).parents[4] / "shared" / "data" / "pendulum"
real = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured pendulums in {DATA}")
FALSE = ("frame_tilt", "encoder_bias", "wire_spring", "pivot_compliance", "quadratic_damping")


def check_triple(verdict: Any) -> None:
    assert verdict.verdict == "named"
    sure = [e.name for e in verdict.effects if e.confidence > 0.85]
    assert sorted(sure) == ["air_drag", "dry_friction"]
    assert 1.5 < verdict.gap.before["angle_mrad"] < 3.0
    assert verdict.gap.after["angle_mrad"] <= 0.9
    assert verdict.gap.shrink_low > 0.4
    (drag,) = (c for c in verdict.candidates if c.name == "air_drag")
    for single in (c for c in verdict.candidates if c.name in FALSE):
        assert single.elpd_gain < 0.2 * drag.elpd_gain


@real
@pytest.mark.slow
def test_triple_pendulum_has_air_drag_and_dry_friction(tmp_path: Path) -> None:
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
    pairs = {c.name: c.p for c in verdict.candidates if c.name.count(" + ") == 1}
    best = min(pairs, key=lambda name: pairs[name])
    assert best in ("air_drag + dry_friction", "dry_friction + quadratic_damping")


@real
def test_error_in_sample_ranks_a_false_cause_that_held_out_runs_refuse() -> None:
    """Quadratic hinges lower the error of the runs that they are fitted to, and only of those."""
    triple = DATA / "triple"
    subject = open_subject(triple / "pendulum.yaml", find_runs([triple / "runs"]), 1)
    scope = subject.scope
    seen = evidence(subject.runs[6::3])
    unseen_runs = evidence(subject.runs[:6:2])
    start = Point(np.array([p.start for p in scope.base]), seen.start())
    base = run_one(subject.simulate, refit(Model(scope.base), seen, start))

    def errors(name: str) -> tuple[float, float]:
        effects = tuple(c for c in scope.candidates if c.name == name)
        model = Model(scope.base, effects)
        point = Point(model.join(base.shared, {}), base.point.local)
        found = run_one(subject.simulate, refit(model, seen, point))
        other = unseen(subject.simulate, found, unseen_runs)
        return tuple(rms(e, scope.quantities)["angle_mrad"] for e in (found, other))

    plain, quadratic, drag = errors("none"), errors("quadratic_damping"), errors("air_drag")
    assert quadratic[0] < plain[0]
    assert quadratic[1] > plain[1]
    assert drag[1] < 0.7 * plain[1]


@real
def test_measured_swings_are_read_whole() -> None:
    subject = open_subject(
        DATA / "triple" / "pendulum.yaml", find_runs([DATA / "triple" / "runs"]), 1
    )
    assert len(subject.runs) == 26
    assert [run.index for run in subject.runs] == list(range(26))
