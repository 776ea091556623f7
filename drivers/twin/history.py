"""The last second of the twin's world, at any instant of it."""

from collections import deque
from dataclasses import replace

from drivers.errors import Fault
from drivers.twin.clock import NANO, nanoseconds
from drivers.twin.scene import Scene
from drivers.types import Pose, frozen


class History:
    """Scenes at regular steps, the oldest forgotten; between them it interpolates linearly."""

    def __init__(self, step: float, memory: float) -> None:
        """Scenes every `step` [s], kept for `memory` [s]."""
        self._step = nanoseconds(step)
        self._scenes: deque[Scene] = deque(maxlen=nanoseconds(memory) // self._step + 2)

    def add(self, scene: Scene) -> None:
        """Remember a scene one step later than the last."""
        self._scenes.append(scene)

    @property
    def newest(self) -> Scene:
        """The last scene."""
        return self._scenes[-1]

    def at(self, stamp: float) -> Scene:
        """The scene at `stamp` [s]; Fault `world_unknown` when it is not remembered."""
        wanted, first = nanoseconds(stamp), nanoseconds(self._scenes[0].stamp)
        if not first <= wanted <= nanoseconds(self.newest.stamp):
            raise Fault(
                "world_unknown",
                f"the world at {stamp:.4f} s cannot be shown; known are "
                f"{first / NANO:.4f} to {self.newest.stamp:.4f} s",
            )
        index, rest = divmod(wanted - first, self._step)
        if rest == 0:
            return self._scenes[index]
        return between(self._scenes[index], self._scenes[index + 1], stamp)


def between(earlier: Scene, later: Scene, stamp: float) -> Scene:
    """The scene at `stamp` [s] between two others; what the hand holds is the earlier one's."""
    share = (stamp - earlier.stamp) / (later.stamp - earlier.stamp)
    here, there = earlier.gripper.as_array(), later.gripper.as_array()
    x, z, pitch = (here + share * (there - here)).tolist()
    points = earlier.points
    if points is not later.points:
        points = frozen(points + share * (later.points - points))
    width = earlier.finger_width + share * (later.finger_width - earlier.finger_width)
    return replace(
        earlier, stamp=stamp, points=points, gripper=Pose(x, z, pitch), finger_width=width
    )
