"""Log of the robot's loop: joints at every tick, and a histogram of the ticks'
intervals.
"""

from bisect import bisect
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.base.types import Array, frozen

JOINT_FIELDS = ("q", "dq", "q_d", "tau_J")  # rad, rad/s, rad, N m
COLUMN_COUNT = 1 + 7 * len(JOINT_FIELDS)
# ms, of the histogram
EDGES_MS = (
    0.25,
    0.5,
    0.75,
    0.9,
    1.1,
    1.25,
    1.5,
    2.0,
    3.0,
    5.0,
    10.0,
    20.0,
    50.0,
    100.0,
)
KEPT_TICKS = 120_000  # ticks, two minutes; older ones are overwritten


class JointLog:
    """Ring buffer of joint states at the newest KEPT_TICKS ticks, allocated in
    advance.
    """

    def __init__(self) -> None:
        self._rows = np.full((KEPT_TICKS, COLUMN_COUNT), np.nan)
        self._count = 0

    def add(self, t: float, state: Any) -> None:
        """Store the JOINT_FIELDS of the robot's `state` at time `t` [s]."""
        row = self._rows[self._count % KEPT_TICKS]
        row[:] = (t, *state.q, *state.dq, *state.q_d, *state.tau_J)
        self._count += 1

    def content(self) -> bytes:
        """All stored rows as bytes, oldest first, for `joint_rows`."""
        if self._count <= KEPT_TICKS:
            return self._rows[: self._count].tobytes()
        return np.roll(self._rows, -(self._count % KEPT_TICKS), axis=0).tobytes()


def joint_rows(content: bytes) -> Array:
    """Array (n, 29) from `JointLog.content`: t [s], then 7 joints for each of
    JOINT_FIELDS.
    """
    return frozen(np.frombuffer(content).reshape(-1, COLUMN_COUNT))


@dataclass(slots=True)
class Timing:
    """Histogram of intervals between the robot's states, with open bins beyond both
    ends.

    `longest` is the longest interval [s]; `heard` sums the shares of commands received
    in time.
    """

    counts: list[int] = field(default_factory=lambda: [0] * (len(EDGES_MS) + 1))
    longest: float = 0.0
    last: float | None = None
    heard: float = 0.0

    def update(self, arrival: float, success: float) -> None:
        """Count a robot state at `arrival` [s]; `success` is the share of commands in
        time.
        """
        self.heard += success
        if self.last is not None:
            interval = arrival - self.last
            self.longest = max(self.longest, interval)
            self.counts[bisect(EDGES_MS, 1e3 * interval)] += 1
        self.last = arrival

    def content(self) -> dict[str, Any]:
        """Histogram of the states' intervals as plain values, for the record of a
        run.
        """
        return {
            "edges_ms": list(EDGES_MS),
            "counts": self.counts,
            "longest_ms": 1e3 * self.longest,
            "answered": self.heard / (1 + sum(self.counts)),
        }
