"""What the parts of a benchmark measure, against known numbers."""

import numpy as np
import pytest

from cell.benchmark.range_parts import FRICTION_EFFECT, EffectPart, RangePart
from cell.benchmark.shape_parts import CriticalPart
from cell.benchmark.side_views import table
from cell.benchmark.summary import misses_text
from cell.report.words import NO_VALUE

pytestmark = pytest.mark.slow

SLOW_X = {0.06: (437, 310), 0.14: (352, 223), 0.22: (268, 140)}  # mm, softest and stiffest


def test_critical_points_of_slow_strips_stand_where_two_other_simulations_put_them() -> None:
    points = CriticalPart(0.02, tuple(SLOW_X), 2, 2, "").measure()
    least_damped = 1e3 * table(points)[:, :, 0]
    np.testing.assert_allclose(least_damped, list(SLOW_X.values()), atol=8.0)


def test_damping_lets_the_gripper_go_further_before_layers_touch() -> None:
    slow, fast = (CriticalPart(v, (0.14,), 2, 2, "").measure() for v in (0.02, 0.1))
    for points in (slow, fast):
        x = table(points)[0]
        assert np.all(x[:, 1] < x[:, 0])
    gone = 1e3 * (table(fast)[0, :, 0] - table(fast)[0, :, 1])
    assert np.all((gone > 80) & (gone < 240))


def test_circle_pulls_ten_times_as_hard_at_the_fixed_edge_as_the_triangle() -> None:
    forces = {
        name: float(np.mean(RangePart(name, "rod", 3, 0.1, "").measure().force))
        for name in ("triangular", "circular")
    }
    assert forces["circular"] == pytest.approx(2.4, abs=0.3)
    assert forces["circular"] > 8 * forces["triangular"]


def test_unknown_friction_spoils_a_plan_and_hardly_the_feedback_of_adaptive() -> None:
    adaptive, planned = (
        EffectPart(policy, FRICTION_EFFECT, 4, 0.1, "").measure()
        for policy in ("adaptive", "planned")
    )
    assert np.abs(adaptive.displacement).max() < 0.006
    assert np.abs(planned.displacement).mean() > 0.008
    assert misses_text(adaptive).count("/") == 2
    assert misses_text(adaptive.model_copy(update={"displacement": (None,)})) == NO_VALUE
