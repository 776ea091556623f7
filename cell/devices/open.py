"""Selection and opening of the devices of a cell, with checks of what they need."""

from ipaddress import ip_address

import cv2

from cell.config.cell import CellFile
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.real_camera import camera_settings, with_real_camera
from cell.devices.rig_correction import corrected_devices
from cell.extras import require_library
from drivers.errors import ConfigurationError, PreflightRefused
from drivers.plugins import guarded
from drivers.strip.file import StripFile


def check_drivers(settings: CellFile, choice: DeviceSelection) -> None:
    """Raise ConfigurationError where a library or setting of the selected devices is missing."""
    for driver in (choice.arm_driver(settings), choice.camera_driver(settings)):
        if driver.library is not None:
            require_library(driver.library)
    if choice.camera_driver(settings).opener:
        camera_settings(settings, choice)
    if robot_address(settings, choice) and is_real(settings, choice) and settings.fci.in_lock_step:
        raise ConfigurationError(
            f"fci.lock_step: is true, but {settings.fci.address} is no twin on this machine: a "
            "real robot cannot run in lock-step; remove the key"
        )


def robot_address(settings: CellFile, choice: DeviceSelection) -> str | None:
    """Address of the Franka robot, real or emulated, that is selected; None for any other arm."""
    return settings.fci.address if choice.arm_driver(settings).is_franka else None


def is_real(settings: CellFile, choice: DeviceSelection) -> bool:
    """Whether the selected arm is a physical robot, not simulated or emulated on this machine."""
    arm = choice.arm_driver(settings)
    address = robot_address(settings, choice)
    if address is None:
        return arm.real and not arm.is_franka
    try:
        return not ip_address(address).is_loopback
    except ValueError:
        return address != "localhost"


def emulation(settings: CellFile, choice: DeviceSelection) -> str:
    """Text for the operator where an emulated robot is selected; empty for any other arm."""
    if not choice.arm_driver(settings).real or is_real(settings, choice):
        return ""
    if settings.fci.address is None:
        return "emulated robot: fci.address in cell.yaml is empty"
    return f"emulated robot at {settings.fci.address}, on this machine"


def check_calibrated(settings: CellFile, choice: DeviceSelection) -> None:
    """Raise ConfigurationError for a real camera without a calibration in cell.yaml."""
    if choice.camera_driver(settings).real and settings.calibration is None:
        name = choice.camera or settings.drivers.camera
        raise ConfigurationError(
            f"cell.yaml: calibration: is missing, camera {name} needs one; run `cell calibrate "
            "camera` and `cell calibrate homography`, then name the file that they make"
        )


def is_physical(settings: CellFile, choice: DeviceSelection) -> bool:
    """Whether a physical robot or a real camera is selected."""
    return is_real(settings, choice) or choice.camera_driver(settings).real


NO_STRIP = StripFile(
    schema=1,
    name="none",
    length=0.6,
    width=0.05,
    areal_density=0.2,
    bending_length=0.02,
    retardation_time=0.03,
)  # the desk is bare while the camera is calibrated


def open_cell(
    settings: CellFile, strip: StripFile, choice: DeviceSelection, *, calibrating: bool
) -> Devices:
    """Open the selected devices; known errors of the rig are compensated unless `calibrating`.

    On the twin without a plant file the plant equals the strip. Raises PreflightRefused for a
    physical robot where nobody agreed to its motion.
    """
    check_drivers(settings, choice)
    if is_real(settings, choice) and not choice.agreed:
        raise PreflightRefused(
            f"the arm is a real robot at {robot_address(settings, choice) or 'its own address'}, "
            "and nobody was asked whether it may move; commands that ask: `cell fold`, `cell "
            "calibrate`, `cell home`, `cell park`, `cell jog`, `cell open`; elsewhere choose arm "
            "twin"
        )
    cv2.setNumThreads(1)  # beside the strip and the record, more threads only wait for each other
    arm = choice.arm_driver(settings)
    with guarded("arms", choice.arm or settings.drivers.arm):
        devices: Devices = arm.load()(settings, strip, choice, calibrating=calibrating)
    if choice.camera_driver(settings).opener and devices.plant is not None:  # else it is open
        devices = with_real_camera(devices, settings, choice)
    return devices if calibrating else corrected_devices(devices, settings, strip)
