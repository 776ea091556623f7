"""Real-time scheduling of the control loop's thread, and garbage collection during a run."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.clock import lock_memory, take_priority, wake_promptly

PRIORITY = 20  # of 1 to 99, of the loop's thread: far below the process that owns the robot
SWITCH_INTERVAL = 0.0005  # s after which a thread that computes hands the interpreter on


@contextmanager
def realtime_thread(real_time: bool) -> Iterator[None]:
    """Within the block, keep the control loop's thread on time, if the run is in `real_time`.

    It takes precedence over threads that record or show: by real-time priority where this user may
    have it, else by short slices of processor time. Memory is locked, and objects made before are
    excluded from garbage collection: to look at half a million of the libraries takes longer than
    an arm follows a velocity target.
    """
    if not real_time:
        yield
        return
    before, interval = (os.sched_getscheduler(0), os.sched_getparam(0)), sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    lock_memory()
    if not take_priority(PRIORITY):
        wake_promptly()
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(interval)
        os.sched_setscheduler(0, *before)
