"""Wall clock for runs on hardware; the twin's clock is `drivers.twin.clock`."""

import time


class WallClock:
    """Monotonic seconds since construction, or since the `origin` of another
    one on this machine.
    """

    def __init__(self, origin: float | None = None) -> None:
        self._start = time.monotonic() if origin is None else origin

    @property
    def origin(self) -> float:
        """Zero of this clock in the system's monotonic time [s], to start an equal clock in another
        process.
        """
        return self._start

    def now(self) -> float:
        """Seconds since the run began."""
        return time.monotonic() - self._start

    def wait_until(self, time_s: float) -> None:
        """Sleep until `time_s`; return at once when it is past."""
        remaining = time_s - self.now()
        if remaining > 0:
            time.sleep(remaining)
