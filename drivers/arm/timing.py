"""Jitter of the robot's states: a histogram of the intervals between them."""

from bisect import bisect
from dataclasses import dataclass, field
from typing import Any

EDGES_MS = (0.25, 0.5, 0.75, 0.9, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0)


@dataclass(slots=True)
class Timing:
    """Counts of intervals between states by `EDGES_MS`, the first and last one open.

    `longest` [s] of them; `answered` is the mean of the robot's own share of commands in time.
    """

    counts: list[int] = field(default_factory=lambda: [0] * (len(EDGES_MS) + 1))
    longest: float = 0.0
    last: float | None = None
    heard: float = 0.0

    def update(self, now: float, success: float) -> None:
        """Record a state that arrived at `now` [s] and its share of commands in time."""
        self.heard += success
        if self.last is not None:
            interval = now - self.last
            self.longest = max(self.longest, interval)
            self.counts[bisect(EDGES_MS, 1e3 * interval)] += 1
        self.last = now

    def content(self) -> dict[str, Any]:
        """Plain values for the record."""
        return {
            "edges_ms": list(EDGES_MS),
            "counts": self.counts,
            "longest_ms": 1e3 * self.longest,
            "answered": self.heard / (1 + sum(self.counts)),
        }
