"""Scenes: states of the simulated world that the twin's camera renders, and their
history.
"""

from collections import deque
from dataclasses import dataclass, replace

from drivers.base.errors import Fault
from drivers.base.types import Array, Pose, frozen
from drivers.twin.clock import NANOSECONDS, nanoseconds


@dataclass(frozen=True, slots=True)
class Scene:
    """State of the simulated world at `stamp` [s of the run], in the cell frame.

    `points` (n, 2) midline (x, z) [m] from the fixed edge on, `arc` (n,) its arc length
    [m]; `gripper` the true pose of the fingers, `finger_width` the distance between
    them [m], `holds_strip` whether they hold the strip's edge, `pointer` whether they
    hold the pin of the calibration instead, `strip` whether a strip lies in the cell at
    all.
    """

    stamp: float
    points: Array
    arc: Array
    gripper: Pose
    finger_width: float
    holds_strip: bool
    pointer: bool = False
    strip: bool = True


class History:
    """Buffer of the newest scenes, at regular steps, with linear interpolation between
    them.
    """

    def __init__(self, step: float, memory: float) -> None:
        """Buffer for scenes at every `step` [s] of the last `memory` [s]."""
        self._step = nanoseconds(step)
        self._scenes: deque[Scene] = deque(maxlen=nanoseconds(memory) // self._step + 2)

    def add(self, scene: Scene) -> None:
        """Append a scene, which must be one `step` later than the last scene."""
        self._scenes.append(scene)

    @property
    def newest(self) -> Scene:
        """Newest scene in the buffer."""
        return self._scenes[-1]

    def at(self, stamp: float) -> Scene:
        """Scene at `stamp` [s]; Fault `world_unknown` where it is not in the buffer."""
        time, first = nanoseconds(stamp), nanoseconds(self._scenes[0].stamp)
        if not first <= time <= nanoseconds(self.newest.stamp):
            raise Fault(
                "world_unknown",
                f"the world at {stamp:.4f} s cannot be shown; known are "
                f"{first / NANOSECONDS:.4f} to {self.newest.stamp:.4f} s",
            )
        index, rest = divmod(time - first, self._step)
        if rest == 0:
            return self._scenes[index]
        return interpolate(self._scenes[index], self._scenes[index + 1], stamp)


def interpolate(earlier: Scene, later: Scene, stamp: float) -> Scene:
    """Scene at `stamp` [s], linear between two scenes, with the grasp of `earlier`."""
    share = (stamp - earlier.stamp) / (later.stamp - earlier.stamp)
    start = earlier.gripper.as_array()
    end = later.gripper.as_array()
    points = earlier.points
    if points is not later.points:
        points = frozen(points + share * (later.points - points))
    gripper = Pose.from_array(start + share * (end - start))
    width = earlier.finger_width + share * (later.finger_width - earlier.finger_width)
    return replace(
        earlier, stamp=stamp, points=points, gripper=gripper, finger_width=width
    )
