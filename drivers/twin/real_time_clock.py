"""A twin's clock that keeps step with the wall clock, for a twin beside a real device."""

import math
import threading

from drivers.clock import WallClock
from drivers.twin.clock import TwinClock

LATE_AT_MOST = 0.002  # s that the world may be behind the wall
PIECE_TIME = 0.005  # s of the world between two looks at the wall


class RealTimeClock:
    """Wall clock (`drivers.protocols.Clock`) that advances the twin's world to the present.

    Its readers may be threads; the twin's own devices read `twin`, so that their stamps say how
    far the world has come. The wall clock starts at the first use, so that construction time does
    not count. A late caller finds the world at the present, as with a real arm. A world that is
    slower than the wall falls behind `now`, and so do the arm's stamps, which a monitor checks.

    With `patience` [s] a late caller is kept no longer than that, and the world catches up when
    there is time: right for a robot that is not part of the world and must be sent where to go.
    """

    def __init__(self, twin: TwinClock, patience: float = math.inf) -> None:
        self._twin = twin
        self._patience = patience
        self._start = twin.now()
        self._wall: WallClock | None = None
        self._first = threading.Lock()  # the camera's thread may be the first to ask

    @property
    def origin(self) -> float:
        """Zero of this clock in the system's monotonic time [s], for another process."""
        return self._running().origin - self._start

    def now(self) -> float:
        """Seconds since the run began."""
        return self._start + self._running().now()

    def wait_until(self, time: float) -> None:
        """Sleep until `time` [s], then advance the twin's world to the present."""
        if self._patience < math.inf:
            self._wait_patiently(time)
            return
        self._running().wait_until(time - self._start)
        self._twin.wait_until(time)
        behind = math.inf
        while LATE_AT_MOST < (lag := self.now() - self._twin.now()) < behind:
            behind = lag  # catching up takes time too, in which the wall goes on
            self._twin.wait_until(self.now())

    def _wait_patiently(self, time: float) -> None:
        self._catch_up(time)
        self._running().wait_until(time - self._start)
        self._catch_up(self.now() + self._patience)

    def _catch_up(self, end: float) -> None:
        """Advance the world by small pieces to the present, at most until wall time `end` [s]."""
        while (now := self.now()) < end and now - self._twin.now() > LATE_AT_MOST:
            self._twin.wait_until(min(self._twin.now() + PIECE_TIME, now))

    def _running(self) -> WallClock:
        with self._first:
            if self._wall is None:
                self._wall = WallClock()
            return self._wall
