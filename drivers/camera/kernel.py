"""System calls of the camera driver behind one protocol, so that tests can replace the kernel."""

import fcntl
import mmap
import os
import select
import time
from typing import Protocol

import numpy as np

from drivers.camera.abi import Argument, Request
from drivers.types import Image

READABLE = select.POLLIN
TROUBLE = select.POLLERR | select.POLLHUP | select.POLLNVAL


class MappedBuffer(Protocol):
    """A kernel buffer mapped into this process."""

    def copy(self, length: int) -> Image:
        """A copy (length,) of the mapping's first bytes."""

    def close(self) -> None:
        """Unmap the buffer."""


class Kernel(Protocol):
    """System calls that the camera driver uses; all raise OSError as the system does."""

    def open(self, path: str) -> int:
        """Open the device at `path` non-blocking and return its file descriptor."""

    def close(self, fd: int) -> None:
        """Close the file descriptor `fd`."""

    def ioctl(self, fd: int, request: Request, argument: Argument) -> None:
        """Execute `request`; the kernel reads and writes `argument`."""

    def map(self, fd: int, length: int, offset: int) -> MappedBuffer:
        """Map the buffer of `length` bytes at `offset` of a device into memory."""

    def wait(self, fd: int | None, seconds: float) -> int:
        """Poll `fd` for `seconds` and return the events, 0 for none; without `fd` only wait."""

    def monotonic(self) -> float:
        """Time [s] on the clock of buffer stamps."""


class _Shared:
    """A buffer mapped with MAP_SHARED."""

    def __init__(self, fd: int, length: int, offset: int) -> None:
        self._memory = mmap.mmap(
            fd, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset
        )

    def copy(self, length: int) -> Image:
        """A copy (length,) of the mapping's first bytes."""
        return np.frombuffer(self._memory[:length], np.uint8)

    def close(self) -> None:
        """Unmap the buffer."""
        self._memory.close()


class Linux:
    """System calls of the Linux kernel on this machine."""

    def open(self, path: str) -> int:
        """Open the device at `path` non-blocking and return its file descriptor."""
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def close(self, fd: int) -> None:
        """Close the file descriptor `fd`."""
        os.close(fd)

    def ioctl(self, fd: int, request: Request, argument: Argument) -> None:
        """Execute `request`, repeated after a signal."""
        while True:
            try:
                fcntl.ioctl(fd, request, argument, True)
            except InterruptedError:
                continue
            return

    def map(self, fd: int, length: int, offset: int) -> MappedBuffer:
        """Map the buffer of `length` bytes at `offset` of a device into memory."""
        return _Shared(fd, length, offset)

    def wait(self, fd: int | None, seconds: float) -> int:
        """Poll `fd` for `seconds` and return the events, 0 for none; without `fd` only wait."""
        poll = select.poll()
        if fd is not None:
            poll.register(fd, select.POLLIN)
        events = poll.poll(1e3 * seconds)
        return events[0][1] if events else 0

    def monotonic(self) -> float:
        """Time [s] of CLOCK_MONOTONIC."""
        return time.monotonic()
