"""The wall clock, for hardware. The twin's clock lives with the twin."""

import time


class WallClock:
    """Monotonic seconds since it was made."""

    def __init__(self) -> None:
        self._start = time.monotonic()

    def now(self) -> float:
        """Seconds since the run began."""
        return time.monotonic() - self._start

    def wait_until(self, time_s: float) -> None:
        """Sleep until `time_s`; return at once when it is past."""
        remaining = time_s - self.now()
        if remaining > 0:
            time.sleep(remaining)
