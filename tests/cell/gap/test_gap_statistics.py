"""The gap workflow's statistics against textbook values and known processes."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.signal import lfilter

from cell.gap.fitting import robust
from cell.gap.fitting.normal_equations import NormalEquations, covariance
from cell.gap.selection.likelihood import holm
from cell.gap.subject.subject import FitRun, Samples, Series


def test_bounded_step_is_the_minimum_within_the_bounds() -> None:
    rng = np.random.default_rng(3)
    for _ in range(60):
        n = int(rng.integers(1, 10))
        a, b = rng.standard_normal((20, n)), rng.standard_normal(20)
        low = np.where(rng.random(n) < 0.6, 0.0, -np.inf)
        high = np.where(rng.random(n) < 0.3, 0.05, np.inf)
        step = NormalEquations(-a.T @ b, a.T @ a).bounded_step(low, high)
        best = lsq_linear(a, b, (low, high), method="bvls").x
        np.testing.assert_allclose(step, best, atol=1e-6)


def test_a_value_that_nothing_determines_leaves_the_errors_of_others_finite() -> None:
    found = covariance(np.diag([4.0, 0.0]))
    assert np.isfinite(found).all()
    assert found[0, 0] == pytest.approx(0.25)


def test_holm_probabilities_are_the_textbook_ones() -> None:
    textbook = {"a": 0.03, "b": 0.06, "c": 0.06, "d": 0.02}
    assert holm({"a": 0.01, "b": 0.04, "c": 0.03, "d": 0.005}) == pytest.approx(
        textbook
    )


def test_inefficiency_of_correlated_noise_is_that_of_its_process() -> None:
    rng = np.random.default_rng(0)
    long = [FitRun(f"r{k}", "one", _samples(4000)) for k in range(8)]
    white = [*rng.standard_normal((len(long), 4000))]
    walks = [*lfilter([1.0], [1.0, -0.6], white)]
    assert robust.inefficiency(long, walks) == pytest.approx(4.0, rel=0.1)
    assert robust.inefficiency(long, white) == pytest.approx(1.0, abs=0.05)


def _samples(n: int) -> Samples:
    one = Series("angle", "angle", "lift", "middle", np.arange(1.0 * n), 1.0, 1.0, 0.0)
    return Samples.stack([one])
