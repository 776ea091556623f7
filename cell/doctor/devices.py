"""The doctor's checks of devices: robot and its version, camera, locks, calibration."""

from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path

from calibration.calibration import load_calibration
from cell.calibrating.calibration_in_use import age_days, check_current
from cell.config.cell import CellFile
from cell.doctor.check import Check, State
from drivers.camera.camera import report
from drivers.camera.device import Kernel
from drivers.errors import CellError

EXPIRING = 0.8  # of the days that a calibration is believed


def library() -> Check:
    """Check whether the maker's client of the arm is installed."""
    why = "the arm speaks a protocol of its own"
    if find_spec("pylibfranka") is not None:
        return Check("robot library", State.PASS, "pylibfranka is installed", why)
    remedy = "pip install 'folding-cell[fci]' on Linux x86_64, Python 3.11 or 3.12"
    return Check("robot library", State.FAIL, "pylibfranka is missing", why, remedy)


def robot(address: str) -> Check:
    """Check whether a robot answers at `address` in the library's version of the protocol."""
    from drivers.arm.checks import LIBRARY_VERSION, robot_version

    why = "robot and library must speak one version; a mismatch is refused at connect"
    spoken = robot_version(address)
    if spoken is None:
        remedy = "switch the robot on, unlock its brakes, activate FCI in Desk; check fci.address"
        return Check("robot", State.FAIL, f"no robot answers at {address}", why, remedy)
    found = f"{address} speaks version {spoken}, the library {LIBRARY_VERSION}"
    state = State.PASS if spoken == LIBRARY_VERSION else State.FAIL
    return Check("robot", state, found, why, "install the library that fits the robot's system")


def camera(settings: CellFile) -> Check:
    """Check whether the configured camera is connected and its controls are locked as stated."""
    why = "a picture by other settings is measured by a calibration that does not fit it"
    stated = settings.camera
    if stated is None:
        remedy = "run `cell camera` and put what it prints into cell.yaml"
        return Check("camera", State.FAIL, "cell.yaml states none", why, remedy)
    try:
        found = report(Kernel(), stated.device)
    except CellError as error:
        return Check("camera", State.FAIL, str(error), why, "connect it, close other programs")
    values = {control.name: control.value for control in found.controls}
    other = [
        f"{name} is {values.get(name, 'absent')}, configured {wanted}"
        for name, wanted in stated.controls.items()
        if values.get(name) != wanted
    ]
    if other:
        remedy = "close the program that changes it; a fold sets it again when it connects"
        return Check("camera", State.WARN, "; ".join(other), why, remedy)
    count = len(stated.controls)
    return Check("camera", State.PASS, f"{stated.device}, {count} controls as configured", why)


def calibration(settings: CellFile, *, on_twin: bool) -> Check:
    """Check whether the calibration is there, whole, plausible and young enough."""
    why = "everything that the camera sees is measured by it"
    remedy = "run `cell calibrate camera` and `cell calibrate homography`, name the file"
    if settings.calibration is None:
        state = State.PASS if on_twin else State.FAIL
        found = "the twin makes its own" if on_twin else "cell.yaml names none"
        return Check("calibration", state, found, why, remedy)
    try:
        made, now = load_calibration(Path(settings.calibration)), datetime.now(UTC)
        check_current(made, settings.calibration_days, now, on_twin=on_twin)
    except CellError as error:
        return Check("calibration", State.FAIL, str(error), why, remedy)
    age = age_days(made, now)
    found = f"{made.id}, {age:.0f} of {settings.calibration_days:.0f} days old"
    if made.accepted_anyway:
        return Check("calibration", State.WARN, f"{found}, accepted although refused", why, remedy)
    old = not on_twin and age > EXPIRING * settings.calibration_days
    return Check("calibration", State.WARN if old else State.PASS, found, why, remedy)
