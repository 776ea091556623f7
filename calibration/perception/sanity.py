"""Is this image news? Its age, and whether the camera repeats itself while the gripper moves."""

from dataclasses import dataclass
from math import hypot

import numpy as np

from drivers.types import Frame, Pose

MOVED = 0.002  # m or, times a finger's length, rad: a gripper that moved so far looks otherwise
FINGER = 0.045  # m


@dataclass(frozen=True, slots=True)
class ImageHealth:
    """Age [s] of the newest image, and how many images in a row equal it byte for byte although
    the gripper moved; 1 for an image that is news.
    """

    age: float
    identical: int


class ImageSanity:
    """Told every frame; remembers one.

    A camera is frozen when it shows the same picture of a gripper that has moved. Of a scene at
    rest, equal pictures say nothing: a camera without noise delivers them.
    """

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._shown: Pose | None = None
        self._identical = 0

    def tell(self, frame: Frame, now: float, gripper: Pose) -> ImageHealth:
        """Health after `frame`, looked at when the clock says `now` [s].

        `gripper` is the measured pose at the frame's stamp.
        """
        last = self._last
        if last is None or last.sequence != frame.sequence:
            self._compare(last, frame, gripper)
            self._last = frame
        return ImageHealth(now - frame.stamp, self._identical)

    def _compare(self, last: Frame | None, frame: Frame, gripper: Pose) -> None:
        if last is None or not np.array_equal(last.image, frame.image) or self._shown is None:
            self._shown, self._identical = gripper, 1
        elif _distance(self._shown, gripper) > MOVED:
            self._identical += 1


def _distance(one: Pose, other: Pose) -> float:
    """How far apart [m] two poses are seen, a turn by what it moves a finger's end."""
    turn = FINGER * abs(one.pitch - other.pitch)
    return max(hypot(one.x - other.x, one.z - other.z), turn)
