"""What a robot says of its joints at every tick, kept in the process that owns it."""

from typing import Any

import numpy as np

from drivers.types import Array, frozen

JOINT_FIELDS = ("q", "dq", "q_d", "tau_J")  # rad, rad/s, rad, N m
COLUMN_COUNT = 1 + 7 * len(JOINT_FIELDS)
KEPT_TICKS = 120_000  # ticks, two minutes; older ones are overwritten


class JointLog:
    """The newest ticks of a motion; memory is taken before it begins, so that no tick waits."""

    def __init__(self) -> None:
        self._rows = np.full((KEPT_TICKS, COLUMN_COUNT), np.nan)
        self._count = 0

    def add(self, t: float, state: Any) -> None:
        """Keep a state of the robot at `t` [s]."""
        row = self._rows[self._count % KEPT_TICKS]
        row[0] = t
        row[1:8], row[8:15], row[15:22], row[22:29] = state.q, state.dq, state.q_d, state.tau_J
        self._count += 1

    def content(self) -> bytes:
        """All ticks that are kept, the oldest first."""
        first = self._count % KEPT_TICKS if self._count > KEPT_TICKS else 0
        return np.roll(self._rows[: min(self._count, KEPT_TICKS)], -first, axis=0).tobytes()


def joint_rows(content: bytes) -> Array:
    """Rows (n, 29) of what `JointLog.content` sent: t [s], JOINT_FIELDS of seven joints each."""
    return frozen(np.frombuffer(content).reshape(-1, COLUMN_COUNT))
