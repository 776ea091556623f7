"""Hidden cause: a vibration of the gripper that the arm does not measure."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.types import Array
from tests.lab.exam.causes.cause import Cause, Sizes

GROWTH = 0.5  # s after the grasp, over which the amplitude grows


class Wobble(Cause):
    """Adds amplitude sin(2 pi frequency t) [m] to the edge's height, and a share of it to its x.

    Source: assumed; a fan or a pump on a bench drives the fingers behind the last encoder.
    """

    amount: ClassVar[str] = "amplitude"
    sizes: ClassVar[Sizes] = {"medium": {"amplitude": 0.003}, "strong": {"amplitude": 0.006}}

    amplitude: float = Field(ge=0, le=0.01)  # m
    frequency: float = Field(3.7, gt=0, le=50)  # Hz
    sideways: float = Field(0.5, ge=-1, le=1)  # share of the motion along x

    def true_pose(self, pose: Array, time: float) -> Array:
        """True pose (3,) of the edge at `time` [s] after the grasp, reported as `pose` (3,)."""
        if self.amplitude == 0:
            return pose
        swing = self.amplitude * min(time / GROWTH, 1.0)
        swing *= np.sin(2 * np.pi * self.frequency * time)
        return np.asarray(pose + np.array([self.sideways * swing, swing, 0.0]))


CAUSE = Wobble
