"""What the parts of a benchmark measure, against known numbers."""

import numpy as np
import pytest

from cell.benchmark.figures import smooth
from cell.benchmark.range_parts import FRICTION_EFFECT, EffectPart, RangePart
from cell.benchmark.shape_parts import (
    LEVEL_MOTION,
    AdaptationPart,
    CriticalPart,
    EvolutionPart,
    LaidPart,
)
from cell.benchmark.side_views import table
from cell.benchmark.summary import FOLDED_HEIGHT, misses_text
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


def test_both_engines_fold_the_range_alike() -> None:
    rod, chain = (RangePart("shifted", engine, 2, 0.1, "").measure() for engine in ("rod", "chain"))
    np.testing.assert_allclose(rod.d, chain.d, atol=4e-3)


def test_laid_strip_is_as_high_as_the_heavy_elastica() -> None:
    laid = LaidPart(0.5, "").measure()
    height = smooth(np.array(laid.shape))[:, 1].max()
    assert height == pytest.approx(FOLDED_HEIGHT * laid.bending_length, rel=0.03)


def test_shapes_of_a_level_motion_end_where_layers_touch() -> None:
    seen = EvolutionPart(LEVEL_MOTION, 0.05, "").measure()
    assert seen.touch_x is not None
    last = np.array(seen.shapes[-1])
    assert last[0] == pytest.approx([0, 0])
    assert np.array([s[-1][1] for s in seen.shapes]) == pytest.approx(0.14, abs=1e-4)
    near = np.abs(last[:, 0] - seen.touch_x) < 0.006
    assert np.ptp(np.flatnonzero(near)) > 5  # both layers pass there
    assert last[near, 1].max() < 0.004


def test_learned_policy_leads_stiffer_strips_further_before_they_touch() -> None:
    found = AdaptationPart("feedback", 0.1, "").measure()
    ends = np.array([path[-1][0] for path in found.paths])
    assert np.all(np.array(found.bending_lengths[1:]) > found.bending_lengths[:-1])
    assert ends[-1] < ends[0] - 0.02


def test_unknown_friction_spoils_a_plan_and_hardly_the_feedback_of_adaptive() -> None:
    adaptive, planned = (
        EffectPart(policy, FRICTION_EFFECT, 4, 0.1, "").measure()
        for policy in ("adaptive", "planned")
    )
    assert np.abs(adaptive.displacement).max() < 0.006
    assert np.abs(planned.displacement).mean() > 0.008
    assert misses_text(adaptive).count("/") == 2
    assert misses_text(adaptive.model_copy(update={"displacement": (None,)})) == NO_VALUE
