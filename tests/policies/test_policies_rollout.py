"""Folds in simulation: the loop that training, tests and benchmark share."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from drivers.strip.describe import describe
from drivers.strip.engine import Observables
from drivers.strip.file import paper_strip
from drivers.strip.model import StripModel
from drivers.strip.shape import Touch
from drivers.types import Array
from policies.path import triangular
from policies.policy import Decision, Observation
from policies.profile import POINTS, seen_profile
from policies.registry import make_policy
from policies.rollout import Rollout, roll_out
from policies.sensing import EXACT_SENSING, Sensing, SimulatedCamera

STRIP = paper_strip(0.1, 0.01)
ARC = np.linspace(0.0, 0.6, 13)


class Ideal:
    """An engine whose contact is the gripper's x, touching once a gripper comes to `touch_at`."""

    def __init__(self, touch_at: float) -> None:
        self.touch_at = touch_at
        self.poses: list[Array] = []
        self.touch: list[Touch | None] = []

    def reset(self, models: Sequence[StripModel]) -> None:
        self.poses, self.touch = [], [None] * len(models)
        self._time = 0.0

    def step(self, poses: Array, dt: float) -> Observables:
        self._time += dt
        self.poses.append(poses.copy())
        for j, pose in enumerate(poses):
            if self.touch[j] is None and pose[0] < self.touch_at:
                self.touch[j] = Touch(self._time, 0.3, to_grasped=0.31 + 0.001 * j, to_fixed=0.3)
        ones = np.ones(len(poses))
        tip = poses[:, :2]
        return Observables(self._time, poses[:, 0], tip, 2.0 * ones, tip, tuple(self.touch))

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
        return Decision(np.full(n, np.pi), np.full(n, self.speed), np.zeros(n), done)


def fold(policy: object, engine: Ideal, count: int = 2, **settings: object) -> object:
    models = [describe(STRIP)] * count
    chosen = Rollout(**{"sensing": EXACT_SENSING, **settings})
    return roll_out(policy, engine, STRIP, models, settings=chosen, rng=np.random.default_rng(0))


def test_lift_is_the_flat_start_of_the_path() -> None:
    engine = Ideal(touch_at=0.3)
    fold(make_policy("triangular"), engine)
    poses = np.array(engine.poses)[:, 0]
    rising = poses[poses[:, 1] < 0.10]
    travel = np.hypot(0.6 - rising[:, 0], rising[:, 1])
    assert rising[0] == pytest.approx([0.6, 0, 0], abs=2e-3)
    assert rising[:, 2] == pytest.approx(np.pi / 2 * np.clip(travel / 0.1, 0, 1), abs=1e-9)
    assert rising[:, 0] + rising[:, 1] == pytest.approx(0.6)


def test_touch_is_scored_and_force_is_its_mean() -> None:
    folds = fold(make_policy("triangular"), Ideal(touch_at=0.2))
    assert folds.displacement == pytest.approx([0.010, 0.011])
    assert folds.holding_force == pytest.approx([2.0, 2.0])
    assert folds.touched.all()


def test_fold_whose_path_ends_untouched_has_no_displacement() -> None:
    folds = fold(make_policy("triangular"), Ideal(touch_at=-1.0))
    assert np.isnan(folds.displacement).all()
    assert folds.trace[-1, 0] == pytest.approx([0.0, 0.0], abs=5e-3)


def test_gripper_never_turns_faster_than_its_limit() -> None:
    engine = Ideal(touch_at=0.05)
    fold(make_policy("triangular"), engine, acceleration=1.0)
    place = np.array(engine.poses)[:, 0, :2]
    dt = 1 / 180
    change = np.diff(place, 2, axis=0) / dt**2
    assert np.linalg.norm(change, axis=1).max() < 1.0 + 1e-6


def test_images_are_as_old_as_their_stamps_say() -> None:
    policy = Watcher()
    fold(policy, Ideal(touch_at=0.05), sensing=Sensing(0.0, 0.0, 0.0, (0.05, 0.05)))
    late = policy.seen[30]
    assert late.time - late.stamp == pytest.approx(0.05)
    assert late.contact_x - late.x == pytest.approx(0.05 * 0.1)


def test_noise_is_drawn_anew_in_each_image_but_alike_in_each_group() -> None:
    rng = np.random.default_rng(0)
    camera = SimulatedCamera(
        Sensing(0.001, 0.002, 0.0, (0.0, 0.06)), 1 / 60, count=4, groups=2, rng=rng
    )
    tip = np.full((4, 2), 0.4)
    seen = Observables(0.0, np.full(4, 0.3), tip, np.zeros(4), tip, (None,) * 4)
    for _ in range(6):
        camera.remember(seen, np.empty((0, 0, 2)), np.empty((0, 0)), np.empty((0, 2)))
    looks = [camera.look(0.1, np.zeros((4, 2))) for _ in range(400)]
    contact = np.array([look.contact_x for look in looks])
    np.testing.assert_array_equal(contact[:, :2], contact[:, 2:])
    assert contact[:, 0].std() == pytest.approx(0.001, rel=0.15)
    assert np.array([look.tip_x for look in looks])[:, 0].std() == pytest.approx(0.002, rel=0.15)
    assert abs(np.corrcoef(contact[:-1, 0], contact[1:, 0])[0, 1]) < 0.2


def test_policy_is_asked_sixty_times_a_second() -> None:
    policy = Watcher()
    fold(policy, Ideal(touch_at=0.05))
    times = np.array([seen.time[0] for seen in policy.seen])
    assert np.diff(times) == pytest.approx(1 / 60)


def test_profile_runs_from_the_desk_contact_to_the_gripper_of_the_image() -> None:
    policy = Watcher()
    fold(policy, Ideal(touch_at=0.05), sensing=replace(EXACT_SENSING, delay=(0.05, 0.05)))
    seen = policy.seen[30]
    assert seen.profile.shape == (2, POINTS, 2)
    assert seen.profile[:, 0, 0] == pytest.approx(seen.contact_x)
    assert seen.profile[:, -1, 0] == pytest.approx(seen.x + 0.05 * 0.1)


def test_dropped_image_leaves_the_one_before_it() -> None:
    policy = Watcher()
    fold(policy, Ideal(touch_at=0.05), sensing=replace(EXACT_SENSING, dropped=(0.5, 0.5)))
    stamps = np.array([seen.stamp[0] for seen in policy.seen])
    fresh = np.diff(stamps) > 0
    assert fresh.mean() == pytest.approx(0.5, abs=0.1)
    assert (np.diff(stamps) >= 0).all()


def test_image_begins_at_the_contact_and_ends_at_the_gripper() -> None:
    points = np.column_stack([np.linspace(0.302, 0.40, 150), np.linspace(0.002, 0.20, 150)])
    seen = seen_profile(points, 0.3, (0.405, 0.21))
    assert seen.shape == (1, POINTS, 2)
    assert seen[0, 0] == pytest.approx([0.3, 0.001])
    assert seen[0, -1] == pytest.approx([0.405, 0.21])
    assert np.isnan(seen_profile(points[:1], 0.3, (0.405, 0.21))).all()
