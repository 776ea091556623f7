"""The twin's world: a strip that follows stamped poses, its past, its truth."""

import numpy as np
import pytest

from drivers.base.errors import Fault
from drivers.base.types import Pose
from drivers.strip.describe import describe
from drivers.strip.engine import Observables, Touch
from drivers.strip.file import StripFile
from drivers.twin.settings import WorldSettings
from drivers.twin.world import World
from tests.support.twin_moves import Steps

STRIP = StripFile.model_validate(
    {
        "schema": 1,
        "name": "ribbon",
        "length": 0.6,
        "width": 0.05,
        "areal_density": 0.4,
        "bending_length": 0.017,
        "retardation_time": 0.03,
    }
)
EDGE = Pose(0.6, 0.0, 0.0)
STEP = 0.005


class Ruler:
    """A plant without physics: a straight line from the fixed edge to the gripper."""

    def __init__(self, touch_after: int = 10**9) -> None:
        self.touch_after = touch_after
        self.steps = 0

    def reset(self, models) -> None:
        self._points = np.linspace([0.0, 0.0], [models[0].stated_length, 0.0], 7)

    def step(self, poses, dt) -> Observables:
        self.steps += 1
        time = self.steps * dt
        self._points = np.linspace([0.0, 0.0], poses[0, :2], 7)
        touched = self.steps >= self.touch_after
        touch = Touch(self.touch_after * dt, 0.2, 0.3, 0.25) if touched else None
        one = np.array([time])
        felt = np.array([[0.01, -time]])
        return Observables(one, np.array([[time, 0.1]]), one, felt, (touch,))

    def shapes(self):
        return self._points[None]

    def arc(self):
        return np.linspace(0.0, 0.6, 7)[None]

    def release(self) -> None:
        """It stays where it is."""


def world_with(plant: Ruler) -> World:
    return World(describe(STRIP), plant, WorldSettings(), EDGE, opening=0.04)


def carry(world: World, poses, start: float, dt: float = 0.001) -> None:
    """Follow `poses` at every `dt` from `start` on, advancing at each."""
    for number, pose in enumerate(poses, start=1):
        world.add_pose(start + number * dt, lambda pose=pose: pose)
        world.advance(start + number * dt)


def line(start: Pose, end: Pose, count: int) -> list[Pose]:
    return [
        Pose(*p) for p in np.linspace(start.as_array(), end.as_array(), count + 1)[1:]
    ]


def test_second_grasp_is_refused_by_name() -> None:
    world = world_with(Ruler())
    world.attach()
    world.detach()
    with pytest.raises(Fault, match="once") as caught:
        world.attach()
    assert caught.value.name == "grasp_not_simulated"


def test_truth_is_in_run_time_and_scores_the_edges() -> None:
    world = world_with(Ruler(touch_after=10))
    carry(world, line(EDGE, EDGE, 300), 0.0)
    world.attach()
    assert world.touch is None
    steps = Steps(world)
    carry(world, line(EDGE, Pose(-0.02, 0.0, 3.0), 100), 0.3)
    truth = steps.truth()
    assert truth.t == pytest.approx(0.305 + STEP * np.arange(20))
    assert truth.touch.time == pytest.approx(0.35)
    assert truth.touch.displacement == pytest.approx(0.05)
    assert world.edge_offset == pytest.approx(0.02)
    assert truth.edge[-1] == pytest.approx([-0.02, 0.0, 3.0])
