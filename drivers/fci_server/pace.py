"""Wall-clock timing of the server: control periods of 1 ms, and a stopwatch."""

import time

from drivers.fci_server.limits import TICK

LONGEST_CATCH_UP = 0.2 * TICK  # s at most by which a period is shortened to make up for a late one


class Pace:
    """Timer of control periods of 1 ms, none of which is shorter than 0.8 ms."""

    def __init__(self) -> None:
        self._deadline = time.monotonic()

    def remaining(self) -> float:
        """Time [s] until the next period is due; at most zero when it is."""
        return self._deadline - time.monotonic()

    def begin_next(self) -> None:
        """Go to the next period, which begins now.

        Where this machine was late, the robot's time falls behind the wall clock's: a robot never
        is, and gives its client a whole period to answer each state.
        """
        now = time.monotonic()
        self._deadline = max(self._deadline, now - LONGEST_CATCH_UP) + TICK

    def restart(self) -> None:
        """Begin to count periods anew, from now."""
        self._deadline = time.monotonic() + TICK


class Stopwatch:
    """A timer that reports when its duration has passed since the last reset."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._since = time.monotonic()

    def reset(self) -> None:
        """Start the duration anew, from now."""
        self._since = time.monotonic()

    def rang(self) -> bool:
        """Whether the duration has passed; if so, the timer restarts."""
        if time.monotonic() - self._since < self._seconds:
            return False
        self.reset()
        return True
