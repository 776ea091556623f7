"""The server's clock: control periods of the wall clock."""

import time

from drivers.twin.server.limits import TICK

LATE = 20 * TICK  # s, after which missed periods are not made up for


class Pace:
    """Deadlines at 1 kHz; the only user of time in the server."""

    def __init__(self) -> None:
        self._deadline = time.monotonic()

    def remaining(self) -> float:
        """Time [s] until the next period is due; zero or less when it is."""
        return self._deadline - time.monotonic()

    def passed(self) -> None:
        """Go to the next period; after a long delay it counts from now."""
        now = time.monotonic()
        self._deadline = max(self._deadline, now - LATE) + TICK

    def restart(self) -> None:
        """Count periods from now."""
        self._deadline = time.monotonic() + TICK


class Stopwatch:
    """A timer that reports when its duration has passed since the last reset."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._since = time.monotonic()

    def reset(self) -> None:
        """Count from now."""
        self._since = time.monotonic()

    def rang(self) -> bool:
        """Whether the duration has passed; if so, the timer restarts."""
        if time.monotonic() - self._since < self._seconds:
            return False
        self.reset()
        return True
