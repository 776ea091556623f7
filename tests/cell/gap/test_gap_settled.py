"""No jump of a sample determines an interval: slopes count as far as both sides show them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cell.gap.fitting.gauss_newton import Estimate, final_fit, refit
from cell.gap.fitting.model import Model, Point, evidence
from cell.gap.fitting.tasks import run_one
from cell.gap.subject.subject import Request, Residuals, Scope
from cell.gap.verdict.compose import intervals
from tests.cell.gap.test_gap_engine import Curves, fitted, nothing

SLOPE, STEP = 0.5, 2e-3  # m/s, of the curves and of the secants
JUMP, HEIGHT = 0.499, 0.3  # m/s, beyond which the model goes another way in one run, by so much [m]


class Jumping(Curves):
    """Curves of which the model, unlike what was measured, goes another way beyond a slope."""

    @property
    def scope(self) -> Scope:
        scope = super().scope
        offset, slope = scope.base
        return replace(scope, base=(offset, replace(slope, step=STEP)))

    def simulate(self, requests: Sequence[Request]) -> list[Residuals]:
        found = super().simulate(requests)
        for q, residuals in zip(requests, found, strict=True):
            if q.run.name == "r0" and q.base[1] > JUMP:
                residuals.mean[40:50] -= HEIGHT
        return found


def before_the_jump(subject: Jumping) -> Estimate:
    """The fit that comes from where there is no jump."""
    runs, model = evidence(subject.runs), Model(subject.scope.base)
    start = Point(np.array([0.2, SLOPE - 0.01]), runs.start())
    return run_one(subject.simulate, refit(model, runs, start))


def slope(estimate: Estimate) -> tuple[float, float]:
    found = intervals(estimate, 1.0, ())["base"][1]
    assert found.low is not None
    assert found.high is not None
    return found.low, found.high


def test_interval_beside_a_jump_is_that_of_all_other_samples() -> None:
    plain, mended, wide = 0, 0, []
    for seed in range(10):
        subject = Jumping(nothing, seed=seed)
        fit = before_the_jump(subject)
        done = run_one(subject.simulate, final_fit(fit))
        plain += slope(fit)[0] < SLOPE < slope(fit)[1]
        mended += slope(done)[0] < SLOPE < slope(done)[1]
        usual = slope(fitted(Curves(nothing, seed=seed)))
        wide.append(np.diff(slope(done))[0] / np.diff(usual)[0])
    assert plain <= 5
    assert mended >= 8
    assert np.median(wide) == pytest.approx(1.0, abs=0.1)
