"""Path following for a batch of grippers that are commanded by velocity."""

from collections.abc import Callable

import numpy as np

from drivers.base.geometry import unit
from drivers.base.types import Array
from drivers.strip.file import StripFile
from policies.path import Path
from policies.policy import Decision, Observation

SEARCH_WINDOW = 0.03  # m of path ahead in which the nearest point is searched
LOOK_AHEAD = 0.01  # m over which a cross-track error is corrected
LEAD = 0.04  # s of preview: half the time in which a gripper turns a corner
END_TOLERANCE = 0.0005  # m before the path's end from which the gripper has arrived


class Follower:
    """Controller that steers n grippers along one path; their progress never decreases.

    `progress` (n,) is the distance along the path [m] of the point nearest to each
    gripper.
    """

    def __init__(self, path: Path, count: int) -> None:
        self.path = path
        self.progress: Array = np.zeros(count)
        self._reach = path.length

    def decide(self, x: Array, z: Array, speed: float) -> Decision:
        """Command grippers at `x`, `z` (n,) [m] along the path at `speed` [m/s]; done
        at its end.

        The first call searches the entire path, later ones at most SEARCH_WINDOW ahead.
        """
        path = self.path
        points = np.stack([x, z], axis=-1)
        high = np.minimum(self.progress + self._reach, path.length)
        self.progress = _nearest(path, points, self.progress, high)
        self._reach = SEARCH_WINDOW

        # the path's heading LEAD ahead, and back to the path within LOOK_AHEAD
        tangent = tangents(path, self.progress + speed * LEAD)
        offset = path.at(self.progress) - points
        across = offset - np.sum(offset * tangent, axis=-1, keepdims=True) * tangent
        aim = LOOK_AHEAD * tangent + across

        done = self.progress >= path.length - END_TOLERANCE
        return Decision(
            direction=np.asarray(np.arctan2(aim[:, 1], aim[:, 0]) % (2 * np.pi)),
            speed=np.where(done, 0.0, speed),
            done=done,
        )


def _nearest(path: Path, points: Array, low: Array, high: Array) -> Array:
    """Distances (n,) [m] along `path`, in [low, high], of its points nearest to
    `points` (n, 2).
    """
    # the foot of the perpendicular on each of m segments, (n, m), kept within it
    from_start = points[:, None] - path.points[:-1]
    steps = np.diff(path.points, axis=0)
    lengths = np.diff(path.travel)
    along = np.einsum("nms,ms->nm", from_start, steps) / lengths
    travel = path.travel[:-1] + np.clip(along, 0.0, lengths)
    travel = np.clip(travel, low[:, None], high[:, None])

    # the nearest of these
    distance = np.linalg.norm(path.at(travel) - points[:, None], axis=-1)
    segment = np.argmin(distance, axis=1)
    nearest: Array = travel[np.arange(len(points)), segment]
    return nearest


def tangents(path: Path, travel: Array) -> Array:
    """Unit tangents (n, 2) of `path` at distances `travel` (n,) [m]; constant beyond
    its end.
    """
    before = np.searchsorted(path.travel, travel, side="right") - 1
    segment = np.clip(before, 0, len(path.travel) - 2)
    return unit(np.diff(path.points, axis=0)[segment])


class PathPolicy:
    """Policy that follows a path known before the fold, which `path(length)` returns
    for a strip's length [m].
    """

    def __init__(self, name: str, path: Callable[[float], Path]) -> None:
        self.name = name
        self.path = path

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Compute the path for `strip`, and start `count` grippers at its beginning."""
        self._speed = speed
        self._follower = Follower(self.path(strip.length), count)

    def lift(self) -> Path:
        """Path of the lift, which is the policy's whole path."""
        return self._follower.path

    def decide(self, observation: Observation) -> Decision:
        """Command the grippers along the path at the speed given to `reset`; done at
        its end.
        """
        return self._follower.decide(observation.x, observation.z, self._speed)
