"""Following a path by heading, for a batch of grippers commanded by velocity."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.strip.file import StripFile
from drivers.types import Array
from policies.path import Path
from policies.policy import Decision, Observation

WINDOW = 0.03  # m of path ahead in which the nearest point is looked for
LOOK_AHEAD = 0.01  # m over which a cross-track error is steered out
LEAD = 0.05  # s of preview: half the time in which a gripper turns a corner


@dataclass(slots=True)
class Follower:
    """Progress of n grippers along one path; it never runs backwards."""

    path: Path
    progress: Array | None = field(default=None)

    def advance(self, points: Array) -> Array:
        """Distances (n,) along the path [m] nearest to `points` (n, 2); the first call looks
        along the whole path, later ones at most `WINDOW` ahead of the last.
        """
        if self.progress is None:
            low = np.zeros(len(points))
            high = np.full(len(points), self.path.length)
        else:
            low = self.progress
            high = np.minimum(low + WINDOW, self.path.length)
        self.progress = nearest(self.path, points, low, high)
        return self.progress

    def heading(self, points: Array, speed: float) -> Array:
        """Directions (n,) [rad] that bring grippers at `points` (n, 2) along the path."""
        progress = self.advance(points)
        tangent = tangents(self.path, progress + speed * LEAD)
        offset = self.path.at(progress) - points
        across = offset - np.sum(offset * tangent, axis=-1, keepdims=True) * tangent
        aim = LOOK_AHEAD * tangent + across
        return np.arctan2(aim[:, 1], aim[:, 0]) % (2 * np.pi)

    @property
    def finished(self) -> NDArray[np.bool_]:
        """Whether each gripper (n,) has come to the path's end."""
        if self.progress is None:
            return np.zeros(0, dtype=bool)
        return np.asarray(self.progress >= self.path.length - 1e-6)


def nearest(path: Path, points: Array, low: Array, high: Array) -> Array:
    """Distances along the path (n,) in [`low`, `high`] whose points are nearest to `points`."""
    starts, steps = path.points[:-1], np.diff(path.points, axis=0)
    lengths = np.diff(path.travel)
    along = np.einsum("nms,ms->nm", points[:, None] - starts, steps) / lengths
    reach = path.travel[:-1] + np.clip(along, 0.0, lengths)
    reach = np.clip(reach, low[:, None], high[:, None])
    distance = np.linalg.norm(path.at(reach) - points[:, None], axis=-1)
    best = np.argmin(distance, axis=1)
    return np.asarray(reach[np.arange(len(points)), best])


def tangents(path: Path, travel: Array) -> Array:
    """Unit tangents (n, 2) at distances along the path; the last one holds beyond its end."""
    segment = np.clip(
        np.searchsorted(path.travel, travel, side="right") - 1, 0, len(path.travel) - 2
    )
    steps = np.diff(path.points, axis=0)[segment]
    return np.asarray(steps / np.linalg.norm(steps, axis=-1, keepdims=True))


class PathPolicy:
    """A policy that follows a path drawn before the fold; a subclass says which."""

    name = ""

    def __init__(self) -> None:
        self._speed = 0.0
        self._follower: Follower | None = None

    def path(self, length: float) -> Path:
        """The whole path for a strip of `length` [m]."""
        raise NotImplementedError

    def reset(self, strip: StripFile, speed: float, count: int) -> None:  # noqa: ARG002
        """Forget; draw the path for `strip`."""
        self._speed = speed
        self._follower = Follower(self.path(strip.length))

    def lift(self) -> Path:
        """The policy's own path."""
        return self._ready().path

    def decide(self, observation: Observation) -> Decision:
        """Along the path at the configured speed; done at its end."""
        follower = self._ready()
        points = np.stack([observation.x, observation.z], axis=-1)
        direction = follower.heading(points, self._speed)
        done = follower.finished
        speed = np.where(done, 0.0, self._speed)
        return Decision(direction, speed, np.zeros(len(points)), done)

    def _ready(self) -> Follower:
        if self._follower is None:
            raise RuntimeError(f"{self.name}: reset before the first decision")
        return self._follower
