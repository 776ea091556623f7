"""Hidden causes in the rig: gripper and clock."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.base.types import Array
from tests.lab.exam.causes.cause import Cause, Sizes


class CreepingGrip(Cause):
    """The strip's edge slides out of the fingers along its tangent at `rate` [m/s].

    Source: assumed; a soft fabric between smooth fingers whose force fades.
    """

    amount: ClassVar[str] = "rate"
    sizes: ClassVar[Sizes] = {"medium": {"rate": 0.0007}, "strong": {"rate": 0.0012}}

    rate: float = Field(ge=0, le=0.01)

    def true_pose(self, pose: Array, time: float) -> Array:
        """True pose (3,) of the edge at `time` [s] after the grasp, reported as `pose`
        (3,).
        """
        slid = self.rate * time
        return np.asarray(
            pose - slid * np.array([np.cos(pose[2]), np.sin(pose[2]), 0.0])
        )


GROWTH = 0.5  # s after the grasp, over which the amplitude grows


class Wobble(Cause):
    """Adds amplitude sin(2 pi frequency t) [m] to the edge's height, and a share of it
    to its x.

    Source: assumed; a fan or a pump on a bench drives the fingers behind the last
    encoder.
    """

    amount: ClassVar[str] = "amplitude"
    sizes: ClassVar[Sizes] = {
        "medium": {"amplitude": 0.003},
        "strong": {"amplitude": 0.006},
    }

    amplitude: float = Field(ge=0, le=0.01)  # m
    frequency: float = Field(3.7, gt=0, le=50)  # Hz
    sideways: float = Field(0.5, ge=-1, le=1)  # share of the motion along x

    def true_pose(self, pose: Array, time: float) -> Array:
        """True pose (3,) of the edge at `time` [s] after the grasp, reported as `pose`
        (3,).
        """
        swing = self.amplitude * min(time / GROWTH, 1.0)
        swing *= np.sin(2 * np.pi * self.frequency * time)
        return np.asarray(pose + np.array([self.sideways * swing, swing, 0.0]))


class ClockDrift(Cause):
    """Image stamps run ahead of the arm's clock by the share `drift` of the time since
    the grasp.

    Clocks agree at the grasp. Source: assumed; stamps by counting frames of too slow a
    camera.
    """

    amount: ClassVar[str] = "drift"
    sizes: ClassVar[Sizes] = {"medium": {"drift": 0.006}, "strong": {"drift": 0.015}}

    drift: float = Field(ge=0, le=0.05)

    def image_time(self, since: float) -> float:
        """True time [s] after the grasp that an image stamped `since` [s] after the
        grasp shows.
        """
        return since / (1.0 + self.drift)
