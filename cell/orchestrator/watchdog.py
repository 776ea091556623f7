"""Ends a turn of the control loop that hangs, such as in a policy that never decides."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from drivers.errors import Fault


@contextmanager
def at_most(limit: float) -> Iterator[None]:
    """Raise Fault `turn_overtime` within the block once it takes longer than `limit` [s].

    By an alarm of the operating system, which only the main thread hears: elsewhere nothing is
    watched. Code that never returns to the interpreter is not ended; then only the arm's own
    driver brakes, which misses the cell's heartbeat.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def rang(_number: int, _frame: FrameType | None) -> None:
        raise Fault("turn_overtime", f"a turn of the control loop takes longer than {limit:g} s")

    before = signal.signal(signal.SIGALRM, rang)
    signal.setitimer(signal.ITIMER_REAL, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
