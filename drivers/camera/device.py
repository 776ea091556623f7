"""An open V4L2 device: ioctl requests with named errors, identity, formats."""

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
    """Identity of the device: driver, card, bus."""

    driver: str
    card: str
    bus: str


@dataclass(frozen=True, slots=True)
class Device:
    """A capture device opened at `path`."""

    kernel: Kernel
    path: str
    fd: int
    identity: Identity

    @classmethod
    def open(cls, kernel: Kernel, path: str) -> Self:
        """Open `path`; raises CameraLost, CameraBusy or CameraRefused when that fails."""
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
        """Execute `request` and return the filled `argument`; raises the error
        that `named` gives.
        """
        try:
            self.kernel.ioctl(self.fd, request, argument)
        except OSError as error:
            users = users_of(self.path) if error.errno == errno.EBUSY else ""
            raise named(error, self.path, doing, users) from None
        return argument

    def supports(self, request: Request, argument: Argument) -> bool:
        """Execute `request`; False where the device answers that it is not supported.

        Raises the error that `named` gives for any other failure.
        """
        try:
            self.kernel.ioctl(self.fd, request, argument)
        except OSError as error:
            if error.errno in NO_MORE:
                return False
            raise named(error, self.path, f"asking for {request.name}", "") from None
        return True

    def listed(self, request: Request, at: Callable[[int], A]) -> Iterator[A]:
        """Entries of an enumeration by index, until the device has no more."""
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
        """Release the device; errors of an unplugged one are ignored."""
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
