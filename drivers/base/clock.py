"""Wall clock for runs on hardware, and real-time scheduling of a thread on Linux."""

import ctypes
import os
import struct
import time

LOCK_CURRENT, LOCK_ON_FAULT = 1, 4  # of mlockall(2)
SLICE = 100_000  # ns, the shortest that the kernel grants
SCHED_SETATTR = 314  # number of the system call on x86-64


class WallClock:
    """Wall clock [s] that is 0 at `origin` [s] of the system's monotonic clock, by
    default now.
    """

    def __init__(self, origin: float | None = None) -> None:
        self.origin = time.monotonic() if origin is None else origin

    def now(self) -> float:
        """Time [s] of the wall clock since its origin."""
        return time.monotonic() - self.origin

    def wait_until(self, time_s: float) -> None:
        """Sleep until this clock is at `time_s` [s]; returns at once where that has
        passed.
        """
        remaining = time_s - self.now()
        if remaining > 0:
            time.sleep(remaining)


def lock_memory() -> bool:
    """Lock all memory mapped by this process into RAM; returns False where this user
    may not.

    Reading a swapped page from disk takes some milliseconds. Later allocations are not
    locked: they would fail where the user may lock little memory. Source: mlockall(2).
    """
    libc = ctypes.CDLL(None, use_errno=True)
    return int(libc.mlockall(LOCK_CURRENT | LOCK_ON_FAULT)) == 0


def take_priority(priority: int) -> bool:
    """Give this thread real-time `priority`, 1 to 99; returns False where this user may
    not.

    Threads and processes that it starts are ordinary again.
    """
    try:
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except PermissionError:
        return False
    return True


def wake_promptly() -> bool:
    """Request short slices of processor time for this thread; returns False where
    unsupported.

    Under Linux 6.12 and later a thread of the ordinary scheduler that runs briefly and
    often then interrupts computing threads, instead of waiting some milliseconds for
    the end of their slices. Any user may; policy and priority stay, and a thread with
    real-time priority does not need it. Source: the kernel's documentation of EEVDF,
    and `sched_setattr(2)`.
    """
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    # size, policy, flags, nice, priority, runtime, deadline, period of the kernel's
    # sched_attr
    attributes = struct.pack("=IIQiIQQQ", 48, os.SCHED_OTHER, 0, nice, 0, SLICE, 0, 0)
    libc = ctypes.CDLL(None, use_errno=True)
    return int(libc.syscall(SCHED_SETATTR, 0, attributes, 0)) == 0
