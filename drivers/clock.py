"""The wall clock, for hardware. The twin's clock lives with the twin."""

import time


class WallClock:
    """Monotonic seconds since it was made, or since another one's `origin` on the same machine."""

    def __init__(self, origin: float | None = None) -> None:
        self._start = time.monotonic() if origin is None else origin

    @property
    def origin(self) -> float:
        """When time began, for a clock in another process that is to show the same."""
        return self._start

    def now(self) -> float:
        """Seconds since the run began."""
        return time.monotonic() - self._start

    def wait_until(self, time_s: float) -> None:
        """Sleep until `time_s`; return at once when it is past."""
        remaining = time_s - self.now()
        if remaining > 0:
            time.sleep(remaining)
