"""Folds in simulation: the loop that training, tests and benchmark share."""

from collections.abc import Sequence

import numpy as np
import pytest

from drivers.base.geometry import lengths
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.engine import Observables, Touch
from drivers.strip.file import paper_strip
from drivers.strip.model import StripModel
from policies.path import triangular
from policies.policy import Decision, Observation
from policies.registry import make_policy
from policies.rollout import Rollout, roll_out
from policies.sensing import EXACT_SENSING, Sensing

STRIP = paper_strip(0.1, 0.01)
ARC = np.linspace(0.0, 0.6, 13)


class Ideal:
    """An engine whose contact is the gripper's x, touching once a gripper comes to
    `touch_at`.
    """

    def __init__(self, touch_at: float) -> None:
        self.touch_at = touch_at
        self.poses: list[Array] = []
        self.touch: list[Touch | None] = []

    def reset(self, models: Sequence[StripModel]) -> None:
        self.poses, self.touch = [], [None] * len(models)
        self._time = 0.0

    def step(self, poses: Array, dt: float) -> Observables:
        touch = self.touch
        self._time += dt
        self.poses.append(poses.copy())
        for j, pose in enumerate(poses):
            if touch[j] is None and pose[0] < self.touch_at:
                touch[j] = Touch(
                    self._time, 0.3, to_grasped=0.31 + 0.001 * j, to_fixed=0.3
                )
        ones = np.ones(len(poses))
        tip = poses[:, :2]
        return Observables(poses[:, 0], tip, 2.0 * ones, tip, tuple(touch))

    def shapes(self) -> Array:
        flat = np.stack([ARC, np.zeros_like(ARC)], axis=1)
        return np.repeat(flat[None], len(self.touch), axis=0)

    def arc(self) -> Array:
        return np.repeat(ARC[None], len(self.touch), axis=0)


class Watcher:
    """A policy that goes level and keeps what it was shown."""

    name = "watcher"

    def __init__(self) -> None:
        self.seen: list[Observation] = []

    def reset(self, strip: object, speed: float, count: int) -> None:
        self.speed, self.seen = speed, []

    def lift(self) -> object:
        return triangular(0.6)

    def decide(self, observation: Observation) -> Decision:
        self.seen.append(observation)
        n = len(observation.x)
        done = observation.x < 0.1
        return Decision(np.full(n, np.pi), np.full(n, self.speed), done)


def fold(policy: object, engine: Ideal, count: int = 2, **settings: object) -> object:
    models = [describe(STRIP)] * count
    chosen = Rollout(**{"sensing": EXACT_SENSING, **settings})
    return roll_out(
        policy, engine, STRIP, models, settings=chosen, rng=np.random.default_rng(0)
    )


def test_touch_is_scored_and_force_is_its_mean() -> None:
    folds = fold(make_policy("triangular"), Ideal(touch_at=0.2))
    assert folds.displacement == pytest.approx([0.010, 0.011])
    assert folds.holding_force == pytest.approx([2.0, 2.0])
    assert folds.touched.all()


def test_images_are_as_old_as_their_stamps_say() -> None:
    policy = Watcher()
    fold(policy, Ideal(touch_at=0.05), sensing=Sensing(0.0, 0.0, 0.0, (0.05, 0.05)))
    late = policy.seen[30]
    assert late.time - late.stamp == pytest.approx(0.05)
    assert late.contact_x - late.x == pytest.approx(0.05 * 0.1)


@pytest.mark.parametrize("name", ["triangular", "circular", "shifted"])
def test_gripper_stays_within_a_millimetre_of_the_path_but_at_the_apex(
    name: str,
) -> None:
    policy = make_policy(name)
    trace = fold(policy, Ideal(touch_at=-1.0), count=1).trace[:, 0]
    path = policy.lift()
    dense = path.at(np.linspace(0, path.length, 4001))
    away = np.array([lengths(dense - point).min() for point in trace[:-1]])
    near_apex = (name != "circular") & (
        lengths(trace[:-1] - path.at(path.length / 2)) < 0.03
    )
    assert away[~near_apex].max() < 1e-3
    assert away.max() < 5e-3
    assert lengths(trace[-1] - path.points[-1]) < 2e-3
