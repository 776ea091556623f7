"""Opening of the devices of a cell, and checks of what these need."""

import cv2

from cell.base.config.cell import CellFile
from cell.base.devices.devices import Devices, Trial
from cell.base.devices.real_camera import camera_settings, with_real_camera
from cell.base.devices.rig_correction import corrected_devices
from drivers.base.errors import ConfigurationError, PreflightRefused
from drivers.base.extras import require_library
from drivers.base.plugins import guarded
from drivers.strip.file import StripFile


def check_drivers(settings: CellFile) -> None:
    """Raise ConfigurationError where a library or a setting that the cell's devices
    need is missing.
    """
    for driver in (settings.arm_driver, settings.camera_driver):
        if driver.library is not None:
            require_library(driver.library)
    if settings.camera_driver.opener:
        camera_settings(settings)
    if settings.robot_address and settings.has_real_arm and settings.fci.in_lock_step:
        raise ConfigurationError(
            f"fci.lock_step: is true, but {settings.fci.address} is no twin on this"
            " machine: a real robot cannot run in lock-step; remove the key"
        )


def check_calibrated(settings: CellFile) -> None:
    """Raise ConfigurationError for a cell with a real camera whose `settings` name no
    calibration.
    """
    if settings.camera_driver.real and settings.calibration is None:
        raise ConfigurationError(
            f"cell.yaml: calibration: is missing, camera {settings.drivers.camera}"
            " needs one; run `cell calibrate camera` and `cell calibrate homography`,"
            " then name the file that they make"
        )


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
    settings: CellFile, strip: StripFile, trial: Trial, *, calibrating: bool
) -> Devices:
    """Open the devices of the cell; known errors of the rig are compensated unless
    `calibrating`.

    On the twin without a plant file the plant equals the strip. Raises PreflightRefused
    for a physical robot where nobody agreed to its motion.
    """
    check_drivers(settings)
    if settings.has_real_arm and not trial.agreed:
        raise PreflightRefused(
            f"the arm is a real robot at {settings.robot_address or 'its own address'},"
            " and nobody was asked whether it may move; commands that ask: `cell"
            " fold`, `cell calibrate`, `cell home`, `cell park`, `cell jog`, `cell"
            " open`; elsewhere choose arm twin"
        )

    # beside the strip and the record, more threads only wait for each other
    cv2.setNumThreads(1)
    with guarded("arms", settings.drivers.arm):
        open_devices = settings.arm_driver.load()
        devices: Devices = open_devices(settings, strip, trial, calibrating=calibrating)

    if settings.camera_driver.opener and devices.plant is not None:  # else it is open
        devices = with_real_camera(devices, settings)
    return devices if calibrating else corrected_devices(devices, settings, strip)
