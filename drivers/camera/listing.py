"""Connected cameras and their capabilities."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from drivers.camera.controls import CameraControl, controls_of
from drivers.camera.device import Device, Identity
from drivers.camera.kernel import Kernel
from drivers.camera.modes import Mode, modes_of
from drivers.errors import CellError

DEVICE_LINKS_FOLDER = Path("/dev/v4l")


@dataclass(frozen=True, slots=True)
class CameraReport:
    """A camera by its link: identity, modes, controls."""

    device: str
    identity: Identity
    modes: tuple[Mode, ...]
    controls: tuple[CameraControl, ...]


@dataclass(frozen=True, slots=True)
class UnusableDevice:
    """A device link that cannot be used as a camera, and the reason."""

    device: str
    problem: str


def list_cameras(
    kernel: Kernel, links: Path = DEVICE_LINKS_FOLDER
) -> Iterator[CameraReport | UnusableDevice]:
    """Every video device that has a link of its own, by id where it has one, else by path."""
    for link in device_links(links):
        try:
            yield report(kernel, link)
        except CellError as error:
            yield UnusableDevice(link, str(error))


def report(kernel: Kernel, link: str) -> CameraReport:
    """Identity, modes and controls of the device at `link`; CellError where it cannot be opened."""
    device = Device.open(kernel, link)
    try:
        controls = tuple(controls_of(device).values())
        return CameraReport(link, device.identity, tuple(modes_of(device)), controls)
    finally:
        device.close()


def device_links(links: Path = DEVICE_LINKS_FOLDER) -> list[str]:
    """Links that udev keeps, one a device: the one by id, else the one by path."""
    found: dict[Path, str] = {}
    for kind in ("by-id", "by-path"):
        for link in sorted((links / kind).glob("*")):
            found.setdefault(link.resolve(), str(link))
    return sorted(found.values())
