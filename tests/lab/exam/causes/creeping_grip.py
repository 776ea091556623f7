"""Hidden cause: a strip that slides slowly out of the fingers."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.types import Array
from tests.lab.exam.causes.cause import Cause, Sizes


class CreepingGrip(Cause):
    """The strip's edge slides out of the fingers along its tangent at `rate` [m/s].

    Source: assumed; a soft fabric between smooth fingers whose force fades.
    """

    amount: ClassVar[str] = "rate"
    sizes: ClassVar[Sizes] = {"medium": {"rate": 0.0007}, "strong": {"rate": 0.0012}}

    rate: float = Field(ge=0, le=0.01)

    def true_pose(self, pose: Array, time: float) -> Array:
        """True pose (3,) of the edge at `time` [s] after the grasp, reported as `pose` (3,)."""
        if self.rate == 0:
            return pose
        slid = self.rate * time
        return np.asarray(pose - slid * np.array([np.cos(pose[2]), np.sin(pose[2]), 0.0]))


CAUSE = CreepingGrip
