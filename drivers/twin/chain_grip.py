"""The grip of a chain: a weld to a target that is led so that the tip does not trail."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from drivers.twin.chain_contact import SHARE, TIME_CONSTANT
from drivers.types import Array

DAMPING = 2 / (SHARE * TIME_CONSTANT)  # 1/s
STIFFNESS = 1 / (SHARE * TIME_CONSTANT**2)  # 1/s^2


@dataclass(frozen=True, slots=True)
class Grip:
    """Where the gripper was last told to be, `pose` (3,) of x, z, pitch, and its `rate` (3,)."""

    pose: Array
    rate: Array

    @classmethod
    def at_rest(cls, pose: Array) -> Self:
        """A gripper that stands still at `pose`."""
        return cls(pose, np.zeros(3))

    def to(self, pose: Array, h: float) -> Self:
        """The grip that has moved to `pose` within `h` [s]."""
        return type(self)(pose, (pose - self.pose) / h)

    def target(self, before: Self, h: float) -> Array:
        """Pose (3,) to which the tip must be welded to stand on this grip's after the step.

        The weld obeys a + b v + k r = 0, with acceleration a, rate v and violation r (tip less
        target) at the step's end; a tip that moves as told has r = -(a + b v) / k.
        """
        acceleration = (self.rate - before.rate) / h
        return self.pose + (acceleration + DAMPING * self.rate) / STIFFNESS
