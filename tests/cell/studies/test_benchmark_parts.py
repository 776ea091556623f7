"""What the parts of a benchmark measure, against known numbers."""

import numpy as np
import pytest

from cell.report.words import NO_VALUE
from cell.studies.parts import FRICTION_EFFECT, fold_effect, fold_range
from cell.studies.summary import misses_text

pytestmark = pytest.mark.slow


def test_circle_pulls_ten_times_as_hard_at_the_fixed_edge_as_the_triangle() -> None:
    forces = {
        name: float(np.mean(fold_range(name, "rod", 3, 0.1).force))
        for name in ("triangular", "circular")
    }
    assert forces["circular"] == pytest.approx(2.4, abs=0.3)
    assert forces["circular"] > 8 * forces["triangular"]


def test_unknown_friction_spoils_a_plan_and_hardly_the_feedback_of_adaptive() -> None:
    adaptive, planned = (
        fold_effect(policy, FRICTION_EFFECT, 4, 0.1)
        for policy in ("adaptive", "planned")
    )
    assert np.abs(adaptive.displacement).max() < 0.006
    assert np.abs(planned.displacement).mean() > 0.008
    assert misses_text(adaptive).count("/") == 2
    assert (
        misses_text(adaptive.model_copy(update={"displacement": (None,)})) == NO_VALUE
    )
