"""Path policies: followed within a millimetre, by one gripper and by many."""

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import StripFile, paper_strip
from drivers.strip.rod.engine import Rod
from policies.path import Path, triangular, vertical_lift
from policies.policy import Observation, Policy
from policies.registry import make_policy, policy_names
from tests.support.effect_cases import simulate

SPEED = 0.1
PERIOD = 1 / 60
STRIP = paper_strip(0.1, 0.01)


def observe(time: float, points: Array) -> Observation:
    n = len(points)
    blank = np.full(n, np.nan)
    return Observation(
        np.full(n, time),
        points[:, 0],
        points[:, 1],
        np.full(n, time),
        blank,
        blank,
        blank,
    )


def follow(
    policy: Policy, start: Array, acceleration: float = 2.0
) -> tuple[Array, Array]:
    """Trace (k, n, 2) of grippers whose velocity answers within `acceleration`, and
    done (n,).
    """
    policy.reset(STRIP, SPEED, len(start))
    points, velocity = start.copy(), np.zeros_like(start)
    trace = [points.copy()]
    done = np.zeros(len(start), dtype=bool)
    for k in range(800):
        decision = policy.decide(observe(k * PERIOD, points))
        done = decision.done
        if done.all():
            break
        heading = np.stack([np.cos(decision.direction), np.sin(decision.direction)], -1)
        change = decision.speed[:, None] * heading - velocity
        size = np.linalg.norm(change, axis=-1, keepdims=True)
        velocity += change * np.minimum(
            1.0, acceleration * PERIOD / np.maximum(size, 1e-12)
        )
        points = points + velocity * PERIOD
        trace.append(points.copy())
    return np.array(trace), done


def distance_to(path: Path, points: Array) -> Array:
    dense = path.at(np.linspace(0, path.length, 4001))
    return np.array([np.linalg.norm(dense - p, axis=-1).min() for p in points])


def takeover(path: Path) -> Array:
    travel = np.linspace(0, path.length / 2, 2001)
    height = path.at(travel)[:, 1]
    return path.at(travel[np.argmax(height >= 0.10)])[None]


@pytest.mark.parametrize("name", ["triangular", "circular", "shifted"])
def test_gripper_stays_within_a_millimetre_of_the_path_but_at_the_apex(
    name: str,
) -> None:
    policy = make_policy(name)
    policy.reset(STRIP, SPEED, 1)
    path = policy.lift()
    trace, done = follow(policy, takeover(path))
    away = distance_to(path, trace[:-1, 0])
    apex = (
        path.at(path.length / 2) if name != "circular" else np.array([np.inf, np.inf])
    )
    near_apex = np.linalg.norm(trace[:-1, 0] - apex, axis=-1) < 0.03
    assert done.all()
    assert away[~near_apex].max() < 1e-3
    assert away.max() < 5e-3
    assert np.linalg.norm(trace[-1, 0] - path.points[-1]) < 2e-3


def test_batch_of_grippers_moves_like_each_alone() -> None:
    starts = takeover(triangular(0.6)) + np.array(
        [[0.0, 0.0], [0.002, 0.0], [-0.02, 0.02]]
    )
    together, _ = follow(make_policy("triangular"), starts)
    for j, start in enumerate(starts):
        alone, _ = follow(make_policy("triangular"), start[None])
        steps = min(len(alone), len(together))
        np.testing.assert_array_equal(alone[:steps, 0], together[:steps, j])


@pytest.mark.parametrize("bending_length", [0.0135, 0.02, 0.033])
def test_lift_that_does_not_push_bends_no_strip_sharply(bending_length: float) -> None:
    strip = STRIP.model_copy(update={"bending_length": bending_length})
    assert sharpest(vertical_lift(0.6), strip) < 20.0
    assert sharpest(triangular(0.6), strip) > 60.0


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
