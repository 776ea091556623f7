"""Fraction of commands that arrived in time, as the robot reports it."""

from collections import deque

TICKS = 100


class Punctuality:
    """Counts over the last TICKS ticks of a motion."""

    def __init__(self) -> None:
        self._came: deque[bool] = deque()
        self._in_time = 0

    @property
    def rate(self) -> float:
        """Between 0 and 1; 0 outside a motion."""
        return self._in_time / len(self._came) if self._came else 0.0

    def count(self, came: bool) -> None:
        """Record one more tick, with or without a command in time."""
        self._came.append(came)
        self._in_time += came
        if len(self._came) > TICKS:
            self._in_time -= self._came.popleft()

    def reset(self) -> None:
        """Clear the counts at the end of a motion."""
        self._came.clear()
        self._in_time = 0
