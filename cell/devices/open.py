"""The one place that picks drivers."""

from importlib.util import find_spec
from typing import Protocol

import cv2

from cell.config.cell import CellFile
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.rig_correction import corrected_devices
from drivers.errors import ConfigurationError
from drivers.strip.file import StripFile


class DeviceFactory(Protocol):
    """What can open a cell: `open_cell`, or what another plant is brought in by."""

    def __call__(
        self, settings: CellFile, strip: StripFile, choice: DeviceSelection, *, calibrating: bool
    ) -> Devices:
        """Devices as configured and chosen."""
        ...


def check_drivers(settings: CellFile, choice: DeviceSelection) -> None:
    """Refuse devices that this version cannot drive, with a ConfigurationError."""
    arm = choice.arm or settings.drivers.arm
    camera = choice.camera or settings.drivers.camera
    if camera != "twin":
        raise ConfigurationError(
            f"drivers: arm {arm!r} with camera {camera!r} is not available in this version; "
            "allowed: arm twin or fci with camera twin"
        )
    if arm == "fci" and find_spec("pylibfranka") is None:
        raise ConfigurationError(
            "drivers: arm 'fci' needs the robot's library; install it with "
            "`pip install 'folding-cell[fci]'` on Linux x86_64, Python 3.11 or 3.12"
        )


def open_cell(
    settings: CellFile, strip: StripFile, choice: DeviceSelection, *, calibrating: bool
) -> Devices:
    """Devices as configured and chosen, effects of the rig that the cell file has inverted.

    On the twin without a plant the strip itself lies there.
    """
    check_drivers(settings, choice)
    cv2.setNumThreads(1)  # beside the strip and the record, more threads only wait for each other
    if calibrating or (choice.arm or settings.drivers.arm) == "twin":
        from cell.devices.twin import twin_devices

        devices = twin_devices(settings, strip, choice, calibrating=calibrating)
    else:
        from cell.devices.fci import fci_devices

        devices = fci_devices(settings, strip, choice)
    return devices if calibrating else corrected_devices(devices, settings, strip)
