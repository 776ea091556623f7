"""An open V4L2 device: requests with named errors, and what it says of itself."""

import errno
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Self, TypeVar

from drivers.camera.abi import CAPTURE, Argument, Can, Capability, FormatDescription, Request
from drivers.camera.errors import CameraLost, CameraRefused, named
from drivers.camera.kernel import Kernel
from drivers.camera.users import users_of

A = TypeVar("A", bound=Argument)

NO_MORE = frozenset({errno.EINVAL, errno.ENOTTY})


@dataclass(frozen=True, slots=True)
class Identity:
    """Who the device says that it is."""

    driver: str
    card: str
    bus: str


@dataclass(frozen=True, slots=True)
class Device:
    """A capture device that is open at `path`."""

    kernel: Kernel
    path: str
    fd: int
    identity: Identity

    @classmethod
    def open(cls, kernel: Kernel, path: str) -> Self:
        """Open `path`; raises CameraLost, CameraBusy or CameraRefused when that cannot be."""
        try:
            fd = kernel.open(path)
        except OSError as error:
            raise named(error, path, "opening it", users_of(path)) from None
        try:
            return cls(kernel, path, fd, _identity(kernel, path, fd))
        except BaseException:
            kernel.close(fd)
            raise

    def call(self, request: Request, argument: A, doing: str) -> A:
        """Carry out `request`; the filled `argument`. Raises what `named` names."""
        try:
            self.kernel.ioctl(self.fd, request, argument)
        except OSError as error:
            users = users_of(self.path) if error.errno == errno.EBUSY else ""
            raise named(error, self.path, doing, users) from None
        return argument

    def supports(self, request: Request, argument: Argument) -> bool:
        """Carry out `request`; False where the device says that there is no such thing.

        Raises what `named` names for any other error.
        """
        try:
            self.kernel.ioctl(self.fd, request, argument)
        except OSError as error:
            if error.errno in NO_MORE:
                return False
            raise named(error, self.path, f"asking for {request.name}", "") from None
        return True

    def listed(self, request: Request, at: Callable[[int], A]) -> Iterator[A]:
        """Entries of a list that is asked for by index, until the device has no more."""
        index = 0
        while self.supports(request, entry := at(index)):
            yield entry
            index += 1

    def formats(self) -> list[FormatDescription]:
        """Pixel formats that the device offers."""
        return list(
            self.listed(Request.ENUM_FMT, lambda i: FormatDescription(index=i, type=CAPTURE))
        )

    def present(self) -> bool:
        """Whether the device still answers."""
        try:
            return self.supports(Request.QUERYCAP, Capability())
        except CameraLost:
            return False

    def close(self) -> None:
        """Let go of the device; what the system says of one that is gone does not matter."""
        try:
            self.kernel.close(self.fd)
        except OSError:
            return


def _identity(kernel: Kernel, path: str, fd: int) -> Identity:
    said = Capability()
    try:
        kernel.ioctl(fd, Request.QUERYCAP, said)
    except OSError as error:
        raise named(error, path, "asking what it is", users_of(path)) from None
    can = said.device_caps if said.capabilities & Can.DEVICE_CAPS else said.capabilities
    if not (can & Can.VIDEO_CAPTURE and can & Can.STREAMING):
        raise CameraRefused(path, "device", "does not stream video; name the camera's video node")
    return Identity(said.driver.decode(), said.card.decode(), said.bus_info.decode())
