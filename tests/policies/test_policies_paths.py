"""Paths of the lift, and the names of policies."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from drivers.strip.describe import describe
from drivers.strip.file import StripFile, paper_strip
from drivers.strip.rod.engine import Rod
from policies.path import Path, triangular, vertical_lift
from policies.planned import RaisedTriangles
from policies.registry import make_policy, policy_names
from tests.support.effect_cases import simulate

STRIP = paper_strip(0.1, 0.01)


@pytest.mark.parametrize("bending_length", [0.0135, 0.02, 0.033])
def test_lift_that_does_not_push_bends_no_strip_sharply(bending_length: float) -> None:
    strip = STRIP.model_copy(update={"bending_length": bending_length})
    assert sharpest(vertical_lift(0.6), strip) < 20.0
    assert sharpest(triangular(0.6), strip) > 60.0


def test_each_gripper_follows_the_triangle_of_its_own_rise() -> None:
    policy = RaisedTriangles(np.array([0.05, 0.0, 0.05]))
    policy.reset(STRIP, 0.1, 3)
    seen: Any = SimpleNamespace(x=np.full(3, 0.45), z=np.full(3, 0.15))
    first, second, third = policy.decide(seen).direction
    assert first == third != second


def sharpest(path: Path, strip: StripFile) -> float:
    """Largest curvature [1/m] on the way to the take-over."""
    t = np.arange(0.0, 1.6, 0.005)
    shapes = simulate(
        Rod(80), describe(strip), t, path.poses(0.1 * t), shapes=True
    ).shapes
    lifted = shapes[shapes[:, -1, 1] < 0.1]
    steps = np.diff(lifted, axis=1)
    turned = np.diff(
        np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1), axis=1
    )
    return float(np.abs(turned).max() / (strip.length / 80))


def test_unknown_policy_names_the_known_ones() -> None:
    assert {"triangular", "circular", "shifted", "feedback"} <= set(policy_names())
    with pytest.raises(ConfigurationError, match=", ".join(policy_names())):
        make_policy("square")
