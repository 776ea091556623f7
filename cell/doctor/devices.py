"""The doctor's checks of devices: robot, its network and version, camera, locks, calibration."""

from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path

from calibration.calibration import load_calibration
from cell.calibrating.calibration_in_use import age_days, check_current
from cell.config.cell import CellFile
from cell.doctor.check import Check, State
from cell.doctor.link import Link, measured_link
from drivers.camera.camera import report
from drivers.camera.device import Kernel
from drivers.errors import CellError

LOST_SHARE, TOO_MANY, IN_A_ROW = 0.01, 0.10, 20  # shares of states; the robot itself stops after 20
LARGEST_DELAY_MS = 2.0  # ms between two states, 99.9 % of them
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


def network(address: str, seconds: float) -> Check:
    """Check whether the robot's states arrive as they are sent, over `seconds`."""
    why = "a robot that misses 20 commands in a row stops with a reflex"
    try:
        return judged_link(measured_link(address, seconds))
    except CellError as error:
        remedy = "close other programs that hold the robot; check cable and address"
        return Check("network", State.FAIL, str(error), why, remedy)


def judged_link(link: Link) -> Check:
    """Check whether a measured network `link` loses few states, and none for long."""
    why = "a robot that misses 20 commands in a row stops with a reflex"
    remedy = (
        "connect the robot to a network card of its own, without a switch; switch off power saving "
        "of processor and card; close busy programs"
    )
    found = (
        f"{link.states} states in {link.seconds:.0f} s, {100 * link.lost_share:.2f} % lost, at "
        f"most {link.in_a_row} in a row; 99.9 % within {link.late_ms:.1f} ms, worst "
        f"{link.worst_ms:.1f} ms"
    )
    state = State.PASS
    if link.lost_share > LOST_SHARE or link.late_ms > LARGEST_DELAY_MS:
        state = State.WARN
    if link.lost_share > TOO_MANY or link.in_a_row >= IN_A_ROW:
        state = State.FAIL
    return Check("network", state, found, why, remedy)


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
