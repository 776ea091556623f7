"""The system calls of the driver, in one place, so that tests can stand in for the kernel."""

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


class Mapping(Protocol):
    """A buffer of the kernel that is seen in this process."""

    def copy(self, length: int) -> Image:
        """(length,) copy of its first bytes."""
        ...

    def close(self) -> None:
        """Take it out of this process."""
        ...


class Kernel(Protocol):
    """What the driver asks of the system. Every method raises OSError as the system says."""

    def open(self, path: str) -> int:
        """Descriptor of a device, which never blocks."""
        ...

    def close(self, fd: int) -> None:
        """Let go of a descriptor."""
        ...

    def ioctl(self, fd: int, request: Request, argument: Argument) -> None:
        """Carry out `request`; the kernel reads and writes `argument`."""
        ...

    def map(self, fd: int, length: int, offset: int) -> Mapping:
        """Buffer of a device."""
        ...

    def wait(self, fd: int | None, seconds: float) -> int:
        """Events of poll on `fd`, 0 when there are none in `seconds`; without `fd`, a pause."""
        ...

    def monotonic(self) -> float:
        """The clock by which buffers are stamped [s]."""
        ...


class _Shared:
    """A shared mapping of the kernel's memory."""

    def __init__(self, fd: int, length: int, offset: int) -> None:
        self._memory = mmap.mmap(
            fd, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset
        )

    def copy(self, length: int) -> Image:
        """(length,) copy of its first bytes."""
        return np.frombuffer(self._memory[:length], np.uint8)

    def close(self) -> None:
        """Take it out of this process."""
        self._memory.close()


class Linux:
    """The kernel that this process runs on."""

    def open(self, path: str) -> int:
        """Descriptor of a device, which never blocks."""
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def close(self, fd: int) -> None:
        """Let go of a descriptor."""
        os.close(fd)

    def ioctl(self, fd: int, request: Request, argument: Argument) -> None:
        """Carry out `request`, again after a signal."""
        while True:
            try:
                fcntl.ioctl(fd, request, argument, True)
            except InterruptedError:
                continue
            return

    def map(self, fd: int, length: int, offset: int) -> Mapping:
        """Buffer of a device."""
        return _Shared(fd, length, offset)

    def wait(self, fd: int | None, seconds: float) -> int:
        """Events of poll on `fd`, 0 when there are none in `seconds`; without `fd`, a pause."""
        poll = select.poll()
        if fd is not None:
            poll.register(fd, select.POLLIN)
        events = poll.poll(1e3 * seconds)
        return events[0][1] if events else 0

    def monotonic(self) -> float:
        """CLOCK_MONOTONIC [s]."""
        return time.monotonic()
