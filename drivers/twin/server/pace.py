"""The server's clock: control periods of the wall clock."""

import time

from drivers.twin.server.limits import TICK

LATE = 20 * TICK  # s, after which missed periods are not made up for


class Pace:
    """Deadlines at 1 kHz; nobody else in the server asks for the time."""

    def __init__(self) -> None:
        self._deadline = time.monotonic()

    def remaining(self) -> float:
        """Time [s] until the next period is due; zero or less when it is."""
        return self._deadline - time.monotonic()

    def passed(self) -> None:
        """One period is over; after a long delay the next one counts from now."""
        now = time.monotonic()
        self._deadline = max(self._deadline, now - LATE) + TICK

    def restart(self) -> None:
        """Count periods from now."""
        self._deadline = time.monotonic() + TICK


class Stopwatch:
    """Tells when a while has passed since it was last set."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._since = time.monotonic()

    def reset(self) -> None:
        """Count from now."""
        self._since = time.monotonic()

    def rang(self) -> bool:
        """Whether the while has passed; if so, it starts again."""
        if time.monotonic() - self._since < self._seconds:
            return False
        self.reset()
        return True
