"""Opens the devices of a cell: the only place that selects drivers."""

from importlib.util import find_spec
from typing import Protocol

import cv2

from cell.config.cell import CellFile
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.real_camera import camera_settings, with_real_camera
from cell.devices.rig_correction import corrected_devices
from drivers.errors import ConfigurationError
from drivers.strip.file import StripFile


class DeviceFactory(Protocol):
    """A function that opens a cell: `open_cell`, or one that provides another plant."""

    def __call__(
        self, settings: CellFile, strip: StripFile, choice: DeviceSelection, *, calibrating: bool
    ) -> Devices:
        """Devices as configured and selected."""
        ...


def check_drivers(settings: CellFile, choice: DeviceSelection) -> None:
    """Refuse devices that this version does not support, with a ConfigurationError."""
    arm = choice.arm or settings.drivers.arm
    if arm == "fci" and find_spec("pylibfranka") is None:
        raise ConfigurationError(
            "drivers: arm 'fci' needs the robot's library; install it with "
            "`pip install 'folding-cell[fci]'` on Linux x86_64, Python 3.11 or 3.12"
        )
    if real_camera(settings, choice):
        camera_settings(settings)


def check_calibrated(settings: CellFile, choice: DeviceSelection) -> None:
    """Raise ConfigurationError for a real camera without a calibration; the twin makes its own."""
    if real_camera(settings, choice) and settings.calibration is None:
        raise ConfigurationError(
            "cell.yaml: calibration: is missing, camera v4l2 needs one; run `cell calibrate "
            "camera` and `cell calibrate homography`, then name the file that they make"
        )


def real_camera(settings: CellFile, choice: DeviceSelection) -> bool:
    """Whether a real camera is selected."""
    return (choice.camera or settings.drivers.camera) == "v4l2"


def open_cell(
    settings: CellFile, strip: StripFile, choice: DeviceSelection, *, calibrating: bool
) -> Devices:
    """Devices as configured and selected, compensated for the rig effects of the cell file.

    On the twin without a plant file the plant equals the strip.
    """
    check_drivers(settings, choice)
    cv2.setNumThreads(1)  # beside the strip and the record, more threads only wait for each other
    if (choice.arm or settings.drivers.arm) == "twin":
        from cell.devices.twin import twin_devices

        devices = twin_devices(settings, strip, choice, calibrating=calibrating)
    else:
        from cell.devices.fci import fci_devices

        devices = fci_devices(settings, strip, choice, calibrating=calibrating)
    if real_camera(settings, choice):
        devices = with_real_camera(devices, settings)
    return devices if calibrating else corrected_devices(devices, settings, strip)
