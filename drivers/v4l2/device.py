"""An open V4L2 device: system calls, ioctl requests, identity, and errors that state a
remedy.
"""

import errno
import fcntl
import mmap
import os
import select
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Self, TypeVar

import numpy as np

from drivers.base.errors import ConfigurationError, Fault
from drivers.base.types import Image
from drivers.v4l2.abi import Argument, Capability, CapabilityFlag, Ioctl

A = TypeVar("A", bound=Argument)

NO_MORE = frozenset({errno.EINVAL, errno.ENOTTY})
STREAMS = CapabilityFlag.VIDEO_CAPTURE | CapabilityFlag.STREAMING
NOBODY_KNOWN = "another program of a user whose processes are hidden"


class MappedBuffer:
    """A frame buffer of the kernel, mapped into the memory of this process."""

    def __init__(self, fd: int, length: int, offset: int) -> None:
        self._memory = mmap.mmap(
            fd, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset
        )

    def copy(self, length: int) -> Image:
        """Copy (length,) of the first bytes of the frame buffer."""
        return np.frombuffer(self._memory[:length], np.uint8)

    def close(self) -> None:
        """Unmap the frame buffer."""
        self._memory.close()


class Kernel:
    """System calls of this machine; all raise OSError as the system does."""

    def open(self, path: str) -> int:
        """Open the device at `path` non-blocking and return its file descriptor."""
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def close(self, fd: int) -> None:
        """Close the device's file descriptor `fd`."""
        os.close(fd)

    def ioctl(self, fd: int, request: Ioctl, argument: Argument) -> None:
        """Make the ioctl `request` with `argument`, repeated where a signal interrupts
        it.
        """
        while True:
            try:
                fcntl.ioctl(fd, request, argument, True)
            except InterruptedError:
                continue
            return

    def map(self, fd: int, length: int, offset: int) -> MappedBuffer:
        """Map the buffer of `length` bytes at `offset` of a device into memory."""
        return MappedBuffer(fd, length, offset)

    def wait(self, fd: int, seconds: float) -> int:
        """Poll `fd` for at most `seconds`; returns its events, 0 for none."""
        poll = select.poll()
        poll.register(fd, select.POLLIN)
        events = poll.poll(1e3 * seconds)
        return events[0][1] if events else 0

    def sleep(self, seconds: float) -> None:
        """Sleep for `seconds`."""
        time.sleep(seconds)

    def monotonic(self) -> float:
        """Time [s] of CLOCK_MONOTONIC."""
        return time.monotonic()


class CameraLost(Fault):
    """Fault of a camera that does not exist or was unplugged."""

    def __init__(self, device: str, problem: str) -> None:
        super().__init__(
            "camera_lost",
            f"{device}: {problem}; plug the camera in, `cell camera` lists what is"
            " there",
        )


class CameraStalled(Fault):
    """Fault of a camera that is connected but delivers no frames."""

    def __init__(self, device: str, seconds: float) -> None:
        super().__init__(
            "camera_stalled",
            f"{device}: no frame for {seconds:.2f} s; check cable and USB bandwidth, "
            "then plug the camera in anew",
        )


class CameraBusy(Fault):
    """Fault of a camera from which another program streams."""

    def __init__(self, device: str, users: str) -> None:
        super().__init__(
            "camera_busy", f"{device}: is in use by {users}; close that program"
        )


class CameraFaulty(Fault):
    """Fault of a camera that is connected but fails, or delivers only corrupt
    frames.
    """

    def __init__(self, device: str, problem: str) -> None:
        super().__init__(
            "camera_faulty",
            f"{device}: {problem}; the stream is started anew, if it stays so try"
            " another cable or port",
        )


class CameraRefused(ConfigurationError):
    """Error for a setting in the cell file that the camera does not accept exactly as
    it stands.
    """

    def __init__(self, device: str, key: str, problem: str) -> None:
        super().__init__(f"{device}: {key}: {problem}")


@contextmanager
def translated(device: str, doing: str) -> Iterator[None]:
    """Within the block, raise an OSError as the fault of the camera at `device`.

    `doing` says in words what fails. Raises CameraLost, CameraBusy, CameraRefused or
    CameraFaulty.
    """
    try:
        yield
    except OSError as error:
        raise _fault(error, device, doing) from None


def _fault(error: OSError, device: str, doing: str) -> Fault | CameraRefused:
    failed = f"{error.strerror or error} while {doing}"
    match error.errno:
        case errno.ENODEV | errno.ENXIO | errno.ENOENT:
            return CameraLost(device, failed)
        case errno.EBUSY:
            return CameraBusy(device, users_of(device))
        case errno.EACCES | errno.EPERM:
            remedy = "may not be opened; join the group video"
            return CameraRefused(device, "device", remedy)
        case errno.ENOTTY:
            return CameraRefused(device, "device", f"{failed}: it cannot do that")
    return CameraFaulty(device, failed)


def users_of(device: str, processes: Path = Path("/proc")) -> str:
    """Names and ids, as text, of other visible processes that have `device` open."""
    node = os.path.realpath(device)
    users = [
        f"{_name(process)} (process {process.name})"
        for process in sorted(processes.glob("[0-9]*"))
        if process.name != str(os.getpid()) and _holds(process, node)
    ]
    return ", ".join(users) or NOBODY_KNOWN


def _holds(process: Path, node: str) -> bool:
    try:
        return any(
            str(entry.readlink()) == node for entry in (process / "fd").iterdir()
        )
    except OSError:
        return False  # ended meanwhile, or not ours to look at


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return "a program"


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of a V4L2 device as the kernel reports it: driver, card, bus."""

    driver: str
    card: str
    bus: str


@dataclass(frozen=True, slots=True)
class Device:
    """An open V4L2 capture device: its file descriptor `fd` and its `path`."""

    kernel: Kernel
    path: str
    fd: int

    @classmethod
    def open(cls, kernel: Kernel, path: str) -> Self:
        """Open the device at `path`; raises CameraLost, CameraBusy or CameraRefused."""
        with translated(path, "opening it"):
            device = cls(kernel, path, kernel.open(path))
        with ExitStack() as undo:  # an open device stays busy for others
            undo.callback(device.close)
            device.identify()
            undo.pop_all()
        return device

    def identify(self) -> Identity:
        """Identity of the device; raises CameraRefused where it streams no video."""
        said = self.call(Ioctl.QUERYCAP, Capability(), "asking what it is")
        abilities = said.capabilities
        if abilities & CapabilityFlag.DEVICE_CAPS:
            abilities = said.device_caps
        if STREAMS & ~abilities:
            raise CameraRefused(
                self.path,
                "device",
                "does not stream video; name the camera's video node",
            )
        return Identity(
            said.driver.decode(), said.card.decode(), said.bus_info.decode()
        )

    def call(self, request: Ioctl, argument: A, doing: str) -> A:
        """Make the ioctl `request` and return the `argument` that the kernel filled.

        Raises CameraLost, CameraBusy, CameraRefused or CameraFaulty, naming what was
        `doing`.
        """
        with translated(self.path, doing):
            self.kernel.ioctl(self.fd, request, argument)
        return argument

    def supports(self, request: Ioctl, argument: Argument) -> bool:
        """Make the ioctl `request`; returns False where the device does not support it.

        Raises CameraLost, CameraBusy, CameraRefused or CameraFaulty for any other
        failure.
        """
        with translated(self.path, f"asking for {request.name}"):
            try:
                self.kernel.ioctl(self.fd, request, argument)
            except OSError as error:
                if error.errno not in NO_MORE:
                    raise
                return False
        return True

    def enumerate_entries(
        self, request: Ioctl, argument: Callable[[int], A]
    ) -> Iterator[A]:
        """Yield answers to `request` with `argument(index)` until the device has no
        more.
        """
        for index in count():
            entry = argument(index)
            if not self.supports(request, entry):
                return
            yield entry

    def present(self) -> bool:
        """Whether the device still answers, unlike an unplugged one."""
        try:
            return self.supports(Ioctl.QUERYCAP, Capability())
        except CameraLost:
            return False

    def close(self) -> None:
        """Release the device; errors of an unplugged device are ignored."""
        with suppress(OSError):
            self.kernel.close(self.fd)
