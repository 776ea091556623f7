"""Mechanisms that others measured and published."""

from pathlib import Path

import pytest

from tests.lab.benchmarks.measure_mechanisms import driven, servo
from tests.support.mechanisms import left, opened
from tests.support.shared import DATA, needs

pytestmark = [pytest.mark.slow, needs(DATA)]


def test_driven_pendulum_misses_what_its_authors_regression_misses(
    tmp_path: Path,
) -> None:
    """Without friction their regression leaves 0.200 N m at the elbow; with Coulomb
    0.131.
    """
    subject = opened(driven(DATA, tmp_path), tmp_path / "runs")
    assert 1.0 < left(subject) < 2.5  # of 0.1 N m
    assert left(subject, dry_friction=[0.093, 0.078, 0.0, 0.0]) < 0.9 * left(subject)


def test_servo_misses_friction_that_grows_with_the_gears_load(tmp_path: Path) -> None:
    subject = opened(servo(DATA, tmp_path), tmp_path / "runs")
    published = [0.0, 0.14]  # M6 of arXiv 2410.08650, of the external torque
    assert left(subject, dry_friction=published) < left(subject)
