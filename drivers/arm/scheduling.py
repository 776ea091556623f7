"""Kernel scheduling of the process that owns the 1 kHz loop, set by `fci.realtime`."""

import ctypes
import os

from drivers.arm.failure import Cause, Failed, Failure
from drivers.arm.settings import RealTime
from drivers.clock import lock_memory, take_priority

PRIORITY = 80  # of 1 to 99, above ordinary threads and below the kernel's own
SLICE = 100_000  # ns, the shortest that the kernel grants
SCHED_SETATTR = 314  # number of the system call on x86-64, the only machine with the library


class _Attributes(ctypes.Structure):
    """The kernel's `struct sched_attr`, first version."""

    _fields_ = (
        ("size", ctypes.c_uint32),
        ("policy", ctypes.c_uint32),
        ("flags", ctypes.c_uint64),
        ("nice", ctypes.c_int32),
        ("priority", ctypes.c_uint32),
        ("runtime", ctypes.c_uint64),
        ("deadline", ctypes.c_uint64),
        ("period", ctypes.c_uint64),
    )


def schedule(mode: RealTime) -> None:
    """Schedule this thread as `mode` asks; to be called once the library has connected.

    Raises Failed where it may not have the real-time priority that is asked for.
    """
    if mode != "ignore":
        lock_memory()
    if mode == "priority" and not take_priority(PRIORITY):
        words = f"this user may not have real-time priority {PRIORITY}, see `ulimit -r`"
        raise Failed(Failure(Cause.REALTIME, words))
    if mode == "ignore":
        wake_promptly()


def wake_promptly() -> bool:
    """Ask for short slices of processor time for this thread; returns False where unsupported.

    Under Linux 6.12 and later a thread of the ordinary scheduler that runs briefly and often then
    interrupts those that compute, instead of waiting for the end of their slices, some
    milliseconds. Any user may; policy and priority stay. Source: the kernel's documentation of
    EEVDF, and `sched_setattr(2)`. A thread with real-time priority needs none of it.
    """
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    asked = _Attributes(ctypes.sizeof(_Attributes), os.SCHED_OTHER, 0, nice, 0, SLICE, 0, 0)
    libc = ctypes.CDLL(None, use_errno=True)
    return int(libc.syscall(SCHED_SETATTR, 0, ctypes.byref(asked), 0)) == 0
