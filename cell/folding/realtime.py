"""Keeps a run free of long pauses by the interpreter."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.clock import lock_memory, take_priority, wake_promptly

PRIORITY = 20  # of 1 to 99, of the loop's thread: far below the process that owns the robot
SWITCH_INTERVAL = 0.0005  # s after which a thread that computes hands the interpreter on


@contextmanager
def without_long_collections() -> Iterator[None]:
    """Within the block, exclude all objects made before it from garbage collection.

    A whole collection looks at some half a million objects of the libraries and takes longer than
    an arm follows a velocity target; what a run itself leaves is looked at in under a millisecond.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def realtime_thread(real_time: bool) -> Iterator[None]:
    """Within the block, keep the control loop's thread on time, if the run is in `real_time`.

    It takes precedence over threads that record or show: by real-time priority where this user may
    have it, else by short slices of processor time; memory is locked, garbage collection is short.
    """
    if not real_time:
        yield
        return
    before, interval = (os.sched_getscheduler(0), os.sched_getparam(0)), sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    lock_memory()
    if not take_priority(PRIORITY):
        wake_promptly()
    try:
        with without_long_collections():
            yield
    finally:
        sys.setswitchinterval(interval)
        os.sched_setscheduler(0, *before)
