"""Camera health: age of the newest image, and frozen images while the gripper moves."""

from dataclasses import dataclass
from math import hypot

import numpy as np

from drivers.types import Frame, Image, Pose

# m or, times a finger's length, rad: a gripper that moved so far looks otherwise
MOVED_DISTANCE = 0.002
FINGER_LENGTH = 0.045  # m
STRIDE = 64  # rows from one to the next that are compared first


@dataclass(frozen=True, slots=True)
class ImageHealth:
    """Age [s] of the newest image, and number of images in a row that are identical with it.

    Equal ones count, byte for byte, between which the gripper moved; 1 for a new image.
    """

    age: float
    identical: int


class ImageSanity:
    """Detects a frozen camera by comparing every frame with the one before.

    A camera is frozen when it repeats the same image although the gripper has moved. Equal images
    of a scene at rest prove nothing: a camera without noise delivers them.
    """

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._gripper: Pose | None = None
        self._identical = 0

    def update(self, frame: Frame, now: float, gripper: Pose) -> ImageHealth:
        """Compare `frame` with the one before at `now` [s]; returns the health of the images.

        `gripper` is the measured pose at the frame's stamp.
        """
        last = self._last
        if last is None or last.sequence != frame.sequence:
            self._compare(last, frame, gripper)
            self._last = frame
        return ImageHealth(now - frame.stamp, self._identical)

    def _compare(self, last: Frame | None, frame: Frame, gripper: Pose) -> None:
        if last is None or not _equal(last.image, frame.image) or self._gripper is None:
            self._gripper, self._identical = gripper, 1
        elif _distance(self._gripper, gripper) > MOVED_DISTANCE:
            self._identical += 1


def _equal(one: Image, other: Image) -> bool:
    """Whether two images are equal; a few rows are compared first, which mostly suffices."""
    first = slice(None, None, STRIDE)
    return np.array_equal(one[first], other[first]) and np.array_equal(one, other)


def _distance(one: Pose, other: Pose) -> float:
    """Apparent distance [m] of two poses; a turn counts by the motion of a finger's end."""
    turn = FINGER_LENGTH * abs(one.pitch - other.pitch)
    return max(hypot(one.x - other.x, one.z - other.z), turn)
