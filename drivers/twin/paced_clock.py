"""A twin's clock that keeps step with the wall, for a twin beside a real device."""

import math
import threading

from drivers.clock import WallClock
from drivers.twin.clock import TwinClock

NEAR = 0.002  # s that the world may be behind the wall


class PacedClock:
    """Satisfies `drivers.protocols.Clock`: time is the wall's, and the twin's world follows it.

    The wall begins to count at the first use, so that what is made before it costs no time. A
    caller that comes late finds the world at the present, as with a real arm. A world that is
    slower than the wall falls behind `now`, and the arm's states with it, which their monitor
    sees.
    """

    def __init__(self, twin: TwinClock) -> None:
        self._twin = twin
        self._start = twin.now()
        self._wall: WallClock | None = None
        self._first = threading.Lock()  # the camera's thread may be the first to ask

    def now(self) -> float:
        """Seconds since the run began."""
        return self._start + self._running().now()

    def wait_until(self, time: float) -> None:
        """Sleep until `time` [s], then let the twin's world go on to the present."""
        self._running().wait_until(time - self._start)
        self._twin.wait_until(time)
        behind = math.inf
        while NEAR < (lag := self.now() - self._twin.now()) < behind:
            behind = lag  # catching up takes time too, in which the wall goes on
            self._twin.wait_until(self.now())

    def _running(self) -> WallClock:
        with self._first:
            if self._wall is None:
                self._wall = WallClock()
            return self._wall
