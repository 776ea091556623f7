"""Mechanisms that others measured and published."""

from pathlib import Path

import numpy as np
import pytest

from cell.gap.subject.mechanism.subject import open_mechanism
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.subject import Request
from tests.lab.benchmarks.measure_mechanisms import DATA, driven, servo, triple
from tests.support.pendulum_mechanism import drag_unit

pytestmark = pytest.mark.slow

real = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured mechanisms in {DATA}")


def rms_of_stated_model(file: Path, runs: Path, effects: dict[str, np.ndarray]) -> float:
    """What a model leaves of all runs, in the unit of its signals, nothing fitted."""
    subject = open_mechanism(file, find_runs([runs]))
    base = np.array([p.start for p in subject.scope.base])
    found = subject.simulate([
        Request(run, base, effects, np.array([p.start for p in run.local])) for run in subject.runs
    ])  # fmt: skip
    return float(np.sqrt(np.mean([np.mean(r.mean**2) for r in found])))


@real
def test_driven_pendulum_misses_what_its_authors_regression_misses(tmp_path: Path) -> None:
    """Without friction their regression leaves 0.200 N m at the elbow; with Coulomb 0.131."""
    file = driven(DATA, tmp_path)
    plain = rms_of_stated_model(file, tmp_path / "runs", {})
    friction = {"dry_friction": np.array([0.093, 0.078, 0.0, 0.0])}
    assert 0.1 < plain < 0.25
    assert rms_of_stated_model(file, tmp_path / "runs", friction) < 0.9 * plain


@real
def test_servo_misses_friction_that_grows_with_the_gears_load(tmp_path: Path) -> None:
    file = servo(DATA, tmp_path)
    plain = rms_of_stated_model(file, tmp_path / "runs", {})
    published = np.array([0.0, 0.14])  # M6 of arXiv 2410.08650, of the external torque
    by_load = rms_of_stated_model(file, tmp_path / "runs", {"dry_friction": published})
    assert by_load < plain


@real
def test_triple_pendulum_moves_as_a_mechanism_as_it_was_measured(tmp_path: Path) -> None:
    """With its authors' numbers and the losses that are known: better than without them."""
    file = triple(DATA, tmp_path)
    plain = rms_of_stated_model(file, tmp_path / "runs", {})
    drag = {"air_drag": np.array([0.024 / drag_unit()])}
    assert plain < 6e-3
    assert rms_of_stated_model(file, tmp_path / "runs", drag) != plain
