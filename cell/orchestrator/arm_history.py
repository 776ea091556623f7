"""Recent measured arm states, for the gripper's pose at an image's stamp."""

from collections import deque

import numpy as np

from drivers.types import ArmState, Pose

LENGTH = 64  # states


class ArmHistory:
    """The last `LENGTH` arm states, oldest first."""

    def __init__(self) -> None:
        self._states: deque[ArmState] = deque(maxlen=LENGTH)

    def add(self, state: ArmState) -> None:
        """Append the newest measured state."""
        self._states.append(state)

    def pose_at(self, stamp: float) -> Pose:
        """The gripper's pose at `stamp` [s], interpolated between the arm's own stamps."""
        times = np.array([state.stamp for state in self._states])
        poses = np.array([state.pose.as_array() for state in self._states])
        return Pose(*(float(np.interp(stamp, times, poses[:, axis])) for axis in range(3)))
