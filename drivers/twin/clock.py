"""Clocks of the twin: a simulated one, which advances its world, and one by the wall
clock.
"""

import heapq
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from itertools import count

from drivers.base.clock import WallClock
from drivers.base.errors import CellError

NANOSECONDS = 1_000_000_000

Action = Callable[[float], None]
LATE_AT_MOST = 0.002  # s that the world may be behind the wall
PIECE_TIME = 0.005  # s of the world between two looks at the wall


class Rank(IntEnum):
    """Kinds of events, in the order in which events at the same instant run."""

    SERVO = 0
    HAND = 1
    WORLD = 2
    CAMERA = 3
    JOB = 4


@dataclass(slots=True)
class TimedCall:
    """Scheduled call of `action(now)` by a simulated clock, once or periodic."""

    action: Action
    rank: Rank
    number: int
    start: float
    period: float | None
    count: int = 1
    cancelled: bool = False

    def cancel(self) -> None:
        """Remove the scheduled call; may be called again, and from within
        the action.
        """
        self.cancelled = True

    def due(self) -> int:
        """Time [ns] of the next call: the start plus a whole number of periods, so that
        it cannot drift.
        """
        return nanoseconds(self.start + self.count * (self.period or 0.0))


class TwinClock:
    """Simulated clock, advanced only by `wait_until` through an ordered queue of
    events.

    Instants are whole nanoseconds, so that a servo tick, a strip step and a frame at
    the same moment are equal; they run by `Rank`, and within a rank in the order in
    which they were scheduled.
    """

    def __init__(self) -> None:
        self._now = 0
        self._queue: list[tuple[int, int, int, TimedCall]] = []
        self._numbers = count()
        self._running = False

    def now(self) -> float:
        """Simulated time [s] since the run began."""
        return self._now / NANOSECONDS

    def every(self, period: float, action: Action, rank: Rank) -> TimedCall:
        """Schedule `action(now)` every `period` [s] from now on; a period lasts at
        least a nanosecond.
        """
        return self._push(
            TimedCall(
                action=action,
                rank=rank,
                number=next(self._numbers),
                start=self.now(),
                period=period,
            )
        )

    def at(self, time: float, action: Action, rank: Rank) -> TimedCall:
        """Schedule `action(now)` once at `time` [s], or for the next `wait_until` if
        past.
        """
        return self._push(
            TimedCall(
                action=action,
                rank=rank,
                number=next(self._numbers),
                start=max(time, self.now()),
                period=None,
            )
        )

    def wait_until(self, time: float) -> None:
        """Run every event up to and including `time` [s]; returns at once if `time` is
        past.

        An exception of an event is raised here with the clock at that event's time.
        Raises CellError when called by an event.
        """
        if self._running:
            raise CellError(
                "clock: an event cannot wait; it can only ask for a later event"
            )

        end = nanoseconds(time)
        self._running = True
        try:
            while self._queue and self._queue[0][0] <= end:
                self._run_next()
        finally:
            self._running = False

        self._now = max(self._now, end)

    def _run_next(self) -> None:
        """Run the first event of the queue and schedule its next call; drop a cancelled
        one.
        """
        queue = self._queue
        time, _, _, event = queue[0]
        if event.cancelled or event.period is None:
            heapq.heappop(queue)
        else:
            event.count += 1
            heapq.heapreplace(queue, (event.due(), event.rank, event.number, event))
        if not event.cancelled:
            self._now = max(self._now, time)
            event.action(self._now / NANOSECONDS)

    def _push(self, event: TimedCall) -> TimedCall:
        heapq.heappush(self._queue, (event.due(), event.rank, event.number, event))
        return event


def nanoseconds(time: float) -> int:
    """Number of nanoseconds nearest to `time` [s]."""
    return round(time * NANOSECONDS)


class RealTimeClock:
    """Clock that runs by the wall clock and advances the twin's world to the present.

    Its readers may be threads; the twin's devices read the simulated clock `twin`, so
    that their stamps say how far the world has come. The wall clock starts at the first
    use, so that construction does not count. A late caller finds the world at the
    present, as with a real arm. A world that is slower than the wall clock falls behind
    `now`, and so do the arm's stamps, which a monitor checks.

    With `patience` [s] no call takes longer than that, and the world catches up when
    there is time: for a real robot, whose commands must not wait for the simulation.
    """

    def __init__(self, twin: TwinClock, patience: float = math.inf) -> None:
        self._twin = twin
        self._patience = patience
        self._start = twin.now()
        self._wall: WallClock | None = None
        self._first = threading.Lock()  # the camera's thread may be the first to ask

    @property
    def origin(self) -> float:
        """System's monotonic time [s] at which this clock is 0, for another process."""
        return self._running().origin - self._start

    def now(self) -> float:
        """Time [s] since the run began, by the wall clock."""
        return self._start + self._running().now()

    def wait_until(self, time: float) -> None:
        """Sleep until this clock is at `time` [s], then advance the twin's world to the
        present.
        """
        twin = self._twin
        if self._patience < math.inf:
            self._catch_up(time)
            self._running().wait_until(time - self._start)
            self._catch_up(self.now() + self._patience)
            return

        self._running().wait_until(time - self._start)
        twin.wait_until(time)
        last_lag = math.inf
        lag = self.now() - twin.now()

        # catching up takes time in which the wall goes on
        while LATE_AT_MOST < lag < last_lag:
            twin.wait_until(self.now())
            last_lag = lag
            lag = self.now() - twin.now()

    def _catch_up(self, end: float) -> None:
        """Advance the world by small pieces to the present, at most until wall time
        `end` [s].
        """
        twin = self._twin
        while (now := self.now()) < end and now - twin.now() > LATE_AT_MOST:
            twin.wait_until(min(twin.now() + PIECE_TIME, now))

    def _running(self) -> WallClock:
        with self._first:
            if self._wall is None:
                self._wall = WallClock()
            return self._wall
