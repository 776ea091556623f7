"""Reports on connected cameras and their capabilities."""

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
    """Report on the camera at link `device`: its identity, modes and controls."""

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
    """Yield a report for each video device with a link, by id where it has one, else by path."""
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
    """One udev link for each video device: by id where it has one, else by path."""
    found: dict[Path, str] = {}
    for kind in ("by-id", "by-path"):
        for link in sorted((links / kind).glob("*")):
            found.setdefault(link.resolve(), str(link))
    return sorted(found.values())
