"""Recent measured arm states, for the gripper's pose at an image's stamp."""

from bisect import bisect_right
from collections import deque

import numpy as np

from drivers.types import ArmState, Pose

STATES_KEPT = 64  # states


class ArmHistory:
    """The last `STATES_KEPT` arm states, oldest first."""

    def __init__(self) -> None:
        self._states: deque[ArmState] = deque(maxlen=STATES_KEPT)

    def add(self, state: ArmState) -> None:
        """Append the newest measured state."""
        self._states.append(state)

    def pose_at(self, stamp: float) -> Pose:
        """Gripper pose at `stamp` [s], interpolated between the stamps of the arm's states."""
        states, last = self._states, len(self._states) - 1
        after = bisect_right(states, stamp, 1, max(last, 1), key=lambda state: state.stamp)
        pair = states[after - 1], states[min(after, last)]
        times, poses = [s.stamp for s in pair], np.array([s.pose.as_array() for s in pair])
        return Pose(*(float(np.interp(stamp, times, poses[:, axis])) for axis in range(3)))
