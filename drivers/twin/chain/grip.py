"""The grip of a chain: a weld whose target leads the commanded pose to cancel its lag."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from drivers.strip.model import StripModel
from drivers.twin.chain.contact import CONSTRAINT_SHARE, TIME_CONSTANT
from drivers.types import Array

HOLD_DAMPING = 2 / (CONSTRAINT_SHARE * TIME_CONSTANT)  # 1/s
HOLD_STIFFNESS = 1 / (CONSTRAINT_SHARE * TIME_CONSTANT**2)  # 1/s^2


@dataclass(frozen=True, slots=True)
class Grip:
    """Commanded gripper `pose` (3,) of x, z, pitch, and its `rate` (3,)."""

    pose: Array
    rate: Array

    @classmethod
    def at_rest(cls, pose: Array) -> Self:
        """A gripper at rest at `pose`."""
        return cls(pose, np.zeros(3))

    def to(self, pose: Array, h: float) -> Self:
        """The grip moved to `pose` within `h` [s]."""
        return type(self)(pose, (pose - self.pose) / h)

    def target(self, before: Self, h: float) -> Array:
        """Weld target (3,) with which the tip is at this grip's pose after the step.

        The weld obeys a + b v + k r = 0, with acceleration a, rate v and violation r (tip minus
        target) at the step's end; a tip on its commanded motion has r = -(a + b v) / k.
        """
        acceleration = (self.rate - before.rate) / h
        return self.pose + (acceleration + HOLD_DAMPING * self.rate) / HOLD_STIFFNESS


APPROACH_STEPS, SETTLING_STEPS = 120, 280  # steps on the way in, and until the strip lies still
VELOCITY_DECAY = 0.9  # of the motion that a step leaves, meanwhile
APPROACH_HEIGHT = 0.7  # of the way in over what a slack strip allows


def approach_poses(model: StripModel) -> Array:
    """Gripper poses (k, 3) that move the free edge from where it lies to its stated place.

    A strip that is too long is brought there in an arc, which leaves its slack as a wave; one that
    is too short is pulled taut. Empty for a strip of exactly the stated length.
    """
    length, stated = model.mechanics.length, model.stated_length
    slack = length - stated
    if slack == 0:
        return np.empty((0, 3))
    share = np.concatenate([np.linspace(0.0, 1.0, APPROACH_STEPS + 1)[1:], np.ones(SETTLING_STEPS)])
    reach = np.sqrt(2 * length * max(slack, 0.0))
    height = APPROACH_HEIGHT * reach * np.sqrt(share * (1 - share))
    return np.stack([length - slack * share, height, np.zeros_like(share)], axis=1)
