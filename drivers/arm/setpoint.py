"""Estimate of the robot's own setpoint of the hand, finer than the rounding of its state."""

from typing import Any

import numpy as np

from drivers.franka.tracking import rotation
from drivers.motion import TICK
from drivers.types import Array

POSE_ROUNDING = 1e-7  # m, and of a rotation's entries: more than the rounding of the state
ACCELERATION_TOLERANCE = 1e-6  # m/s^2 and rad/s^2: likewise, of an acceleration that goes on

Numbers = list[float]


class SetpointEstimate:
    """Estimate of the hand's setpoint in a robot that extrapolates where it misses commands.

    Its state is rounded, and a rounding of 1e-7 m in one tick is 0.1 m/s^2. But a robot that has
    heard nothing keeps its acceleration, so where it is follows from what it heard.
    """

    def __init__(self, state: Any) -> None:
        """Start with the `state` of a robot at rest that receives its commands."""
        self.pose: Numbers = list(state.O_T_EE_c)
        self._change: Numbers = list(state.O_ddP_EE_c)

    def keep_up(self, state: Any, sent: Numbers, ticks: int) -> bool:
        """Advance by `ticks` to `state`; returns whether the robot is not at the pose `sent`.

        `pose` is then the robot's own setpoint, 16 numbers by columns.
        """
        stated, change = list(state.O_T_EE_c), list(state.O_ddP_EE_c)
        heard = largest_difference(change, self._change) > ACCELERATION_TOLERANCE
        went_on = max(ticks - 1, 0) if heard else ticks
        pose = self._extrapolate(sent if heard else self.pose, state, went_on)
        self.pose = pose if largest_difference(pose, stated) < POSE_ROUNDING else stated
        self._change = change
        if ticks > 1 or largest_difference(stated, sent) >= POSE_ROUNDING:
            return True
        if heard:
            self.pose = sent
        return False

    def _extrapolate(self, pose: Numbers, state: Any, ticks: int) -> Numbers:
        """Pose (16 numbers) `ticks` after `pose` without commands, with the twist of `state`."""
        if ticks == 0:
            return pose
        twist, change = np.array(state.O_dP_EE_c), np.array(state.O_ddP_EE_c)
        matrix: Array = np.reshape(pose, (4, 4)).T.copy()
        for ago in range(ticks - 1, -1, -1):
            step = TICK * (twist - ago * TICK * change)
            matrix[:3, 3] += step[:3]
            matrix[:3, :3] = rotation(step[3:]) @ matrix[:3, :3]
        numbers: Numbers = matrix.T.ravel().tolist()
        return numbers


def largest_difference(these: Numbers, those: Numbers) -> float:
    """Largest absolute difference between two lists of numbers, entry by entry."""
    return max(abs(a - b) for a, b in zip(these, those, strict=True))
