"""Intervals hold what measuring gets wrong alike in all runs."""

from dataclasses import replace

import numpy as np
import pytest

from cell.gap.fitting.reml import covariance
from cell.gap.verdict.compose import intervals
from tests.cell.gap.test_gap_engine import Curves, T, fitted, nothing

SLOPE, SIGMA = 0.5, 0.2  # m/s, of the curves and of a common error that grows with time


def biased(seed: int, *, told: bool) -> Curves:
    """Curves whose instrument errs by the same slope in every run, and says so or not."""
    error = SIGMA * float(np.random.default_rng([seed, 5]).standard_normal())
    subject = Curves(lambda t, _, __: error * t, seed=seed)
    return telling(subject) if told else subject


def telling(subject: Curves) -> Curves:
    """The same, with what is known of its instrument."""
    subject.runs = [replace(run, common={"gain": SIGMA * T}) for run in subject.runs]
    return subject


def holds(subject: Curves) -> bool:
    slope = intervals(fitted(subject), 1.0, ())["base"][1]
    assert slope.low is not None
    assert slope.high is not None
    return slope.low < SLOPE < slope.high


def test_interval_holds_the_truth_where_all_runs_err_alike() -> None:
    assert sum(holds(biased(seed, told=True)) for seed in range(20)) >= 18
    assert sum(holds(biased(seed, told=False)) for seed in range(20)) <= 10


def test_common_error_does_not_average_out_over_runs() -> None:
    few, many = (fitted(telling(Curves(nothing, repeats=n))) for n in (1, 4))
    widths = [np.sqrt(covariance(fit, 1.0)[1, 1]) for fit in (few, many)]
    assert widths == pytest.approx([SIGMA, SIGMA], rel=0.05)
