"""Simulation of a strip with hidden causes, the plant of an exam case."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.strip.engine import Observables
from drivers.strip.model import StripModel
from drivers.twin.camera import Visible
from drivers.twin.chain.engine import Chain
from drivers.twin.chain.forces import ForceFunction, Parts
from drivers.twin.scene import Scene
from drivers.types import Array
from tests.lab.exam.case import Scattered
from tests.lab.exam.causes.cause import Cause
from tests.lab.exam.runs.scatter import RunScatter


class Specimen:
    """Engine that simulates one strip under `causes`, random by `seed` and the run's index.

    Runs differ by `scatter` besides. Without causes and scatter it is a chain of `links` links,
    bit for bit.
    """

    def __init__(
        self, links: int, causes: Sequence[Cause], seed: int, scatter: Scattered = "none"
    ) -> None:
        self._links, self._causes, self._seed = links, tuple(causes), seed
        self._level: Scattered = scatter
        self._scatter = RunScatter.draw(scatter, seed, 0)
        self._time = 0.0
        self._chain = Chain(links)

    def reset(self, models: Sequence[StripModel]) -> None:
        """Lay the one strip flat and still, altered by its causes as in run `index`."""
        (model,) = models
        rngs = [
            np.random.default_rng([self._seed, model.index, k]) for k in range(len(self._causes))
        ]
        self._scatter = RunScatter.draw(self._level, self._seed, model.index)
        model = self._scatter.alter(model)
        for cause, rng in zip(self._causes, rngs, strict=True):
            model = cause.alter(model, rng)
        laws = [Law(cause, rng) for cause, rng in zip(self._causes, rngs, strict=True)]
        self._time = 0.0
        self._chain = Chain(self._links, laws)
        self._chain.reset([model])

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance by `dt` [s] to gripper `poses` (1, 3), which causes may offset."""
        self._time += dt
        true = np.asarray(poses, dtype=np.float64)
        if self._level != "none":
            true = np.stack([self._scatter.true_pose(pose, self._time) for pose in true])
        for cause in self._causes:
            true = np.stack([cause.true_pose(pose, self._time) for pose in true])
        return self._chain.step(true, dt)

    def release(self) -> None:
        """Release the grasped edge."""
        self._chain.release()

    def shapes(self) -> Array:
        """Nodes (1, links + 1, 2) [m] of the strip's midline."""
        return self._chain.shapes()

    def arc(self) -> Array:
        """Arc lengths (1, links + 1) [m] of the midline's nodes."""
        return self._chain.arc()


@dataclass(frozen=True, slots=True)
class Law:
    """Extra force of a cause on a chain, with the random generator of the run."""

    cause: Cause
    rng: np.random.Generator

    def begin(self, parts: Parts) -> ForceFunction:
        """Force function of the cause for one chain; does nothing where the cause has no force."""
        act = self.cause.begin(parts, self.rng)
        return _no_force if act is None else act


class Aged:
    """Scene source for a camera whose image stamps differ, by `causes`, from the true time."""

    def __init__(self, world: Visible, causes: Sequence[Cause]) -> None:
        self._world, self._causes = world, tuple(causes)
        self._grasped: float | None = None

    def scene(self, stamp: float) -> Scene:
        """Scene that an image stamped `stamp` [s] shows: the world at the image's true time."""
        if self._grasped is None:
            seen = self._world.scene(stamp)
            if not seen.holds_strip:
                return seen
            self._grasped = stamp
        since = stamp - self._grasped
        for cause in self._causes:
            since = cause.image_time(since)
        return replace(self._world.scene(self._grasped + since), stamp=stamp)


def _no_force(*_: object) -> None:
    """Exert no force: the force function of a cause without forces."""
