"""Checks of a cell's devices before a motion: robot, protocol, network, camera,
calibration.
"""

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.calibration import load_calibration
from cell.base.config.cell import CellFile
from cell.base.config.drivers import DRIVERS
from cell.base.devices.real_camera import grab
from cell.setup.calibration_in_use import age_days, check_current
from cell.setup.doctor.check import FAIL, PASS, SKIPPED, WARN, Check
from drivers.base.child import Child, ChildDied
from drivers.base.errors import CellError, in_ms
from drivers.base.extras import install_advice
from drivers.base.types import Array
from drivers.v4l2.camera import report
from drivers.v4l2.device import Kernel

RATE_SHARE = 0.05  # by which a camera may stay below the rate that it agreed to
EXPIRING = 0.8  # of the days that a calibration is believed
STARTING = 30.0  # s that the measuring process may need beyond its measurement
BUFFERED = 0.25  # s at the start of a measurement
# shares of lost states, for a warning and for a failure
LOST_SHARE, TOO_MANY = 0.01, 0.10
IN_A_ROW = 20  # lost states after which the robot itself stops
LARGEST_DELAY_MS = 2.0  # ms between two states, 99.9 % of them
NETWORK_WHY = "a robot that misses 20 commands in a row stops with a reflex"


def library() -> Check:
    """Check whether pylibfranka, the maker's client of the arm, is installed."""
    why = "the arm speaks a protocol of its own"
    if find_spec("pylibfranka") is not None:
        return Check(
            name="robot library", state=PASS, found="pylibfranka is installed", why=why
        )
    remedy = f"{install_advice('pylibfranka')} on Linux x86_64, Python 3.11 or 3.12"
    return Check(
        name="robot library",
        state=FAIL,
        found="pylibfranka is missing",
        why=why,
        remedy=remedy,
    )


def robot(address: str) -> Check:
    """Check whether a robot answers at `address` in the library's version of the
    protocol.
    """
    from drivers.franka.checks import LIBRARY_VERSION, robot_version

    why = "robot and library must speak one version; a mismatch is refused at connect"
    spoken = robot_version(address)
    if spoken is None:
        remedy = (
            "switch the robot on, unlock its brakes, activate FCI in Desk; check"
            " fci.address"
        )
        return Check(
            name="robot",
            state=FAIL,
            found=f"no robot answers at {address}",
            why=why,
            remedy=remedy,
        )
    found = f"{address} speaks version {spoken}, the library {LIBRARY_VERSION}"
    state = PASS if spoken == LIBRARY_VERSION else FAIL
    return Check(
        name="robot",
        state=state,
        found=found,
        why=why,
        remedy="install the library that fits the robot's system",
    )


def camera(settings: CellFile) -> Check:
    """Check whether the camera of the cell is connected, and its controls are locked as
    the cell file states.
    """
    why = (
        "a picture by other settings is measured by a calibration that does not fit it"
    )
    if settings.camera_driver != DRIVERS["cameras"]["v4l2"]:
        return Check(
            name="camera",
            state=SKIPPED,
            found="a plug-in's",
            why="only its package can check it",
        )
    stated = settings.camera
    if stated is None:
        remedy = "run `cell camera` and put what it prints into cell.yaml"
        return Check(
            name="camera",
            state=FAIL,
            found="cell.yaml states none",
            why=why,
            remedy=remedy,
        )
    try:
        found = report(Kernel(), stated.device)
    except CellError as error:
        return Check(
            name="camera",
            state=FAIL,
            found=str(error),
            why=why,
            remedy="connect it, close other programs",
        )
    values = {control.name: control.value for control in found.controls}
    other = [
        f"{name} is {values.get(name, 'absent')}, configured {wanted}"
        for name, wanted in stated.controls.items()
        if values.get(name) != wanted
    ]
    if other:
        remedy = (
            "close the program that changes it; a fold sets it again when it connects"
        )
        return Check(
            name="camera", state=WARN, found="; ".join(other), why=why, remedy=remedy
        )
    count = len(stated.controls)
    return Check(
        name="camera",
        state=PASS,
        found=f"{stated.device}, {count} controls as configured",
        why=why,
    )


def camera_stream(settings: CellFile) -> Check:
    """Check whether the camera keeps its image rate, and gives its images their times
    itself.
    """
    why = "an image that is late or stamped at its arrival is measured at another pose"
    if settings.camera is None:
        return Check(
            name="pictures", state=SKIPPED, found="cell.yaml states no camera", why=why
        )
    remedy = "give it light, a port of its own without a hub, and close other programs"
    try:
        taken = grab(settings.camera)
    except CellError as error:
        return Check(
            name="pictures", state=FAIL, found=str(error), why=why, remedy=remedy
        )

    agreed = taken.setup.picture.rate
    source, counts = taken.frame.stamp_source, taken.counts
    found = (
        f"{taken.rate:.1f} of {agreed:g} Hz, {counts.missing} missing,"
        f" {counts.corrupt} corrupt, stamped by the {source}, known"
        f" {in_ms(taken.age)} after the exposure"
    )
    slow = taken.rate < (1.0 - RATE_SHARE) * agreed
    unsure = counts.missing or counts.corrupt or counts.restamped
    state = WARN if slow or unsure else PASS
    return Check(name="pictures", state=state, found=found, why=why, remedy=remedy)


def calibration(settings: CellFile, *, on_twin: bool) -> Check:
    """Check whether the cell's calibration exists, is plausible and is
    recent enough.
    """
    calibration_days = settings.calibration_days
    why = "everything that the camera sees is measured by it"
    remedy = (
        "run `cell calibrate camera` and `cell calibrate homography`, name the file"
    )
    if settings.calibration is None:
        state = PASS if on_twin else FAIL
        found = "the twin makes its own" if on_twin else "cell.yaml names none"
        return Check(
            name="calibration", state=state, found=found, why=why, remedy=remedy
        )
    try:
        made = load_calibration(Path(settings.calibration))
        now = datetime.now(UTC)
        check_current(made, calibration_days, now, on_twin=on_twin)
    except CellError as error:
        return Check(
            name="calibration", state=FAIL, found=str(error), why=why, remedy=remedy
        )
    age = age_days(made, now)
    found = f"{made.id}, {age:.0f} of {calibration_days:.0f} days old"
    doubted = not on_twin and age > EXPIRING * calibration_days
    if made.accepted_anyway:
        doubted, found = True, f"{found}, accepted although refused"
    return Check(
        name="calibration",
        state=WARN if doubted else PASS,
        found=found,
        why=why,
        remedy=remedy,
    )


@dataclass(frozen=True, slots=True)
class NetworkLink:
    """Statistics of the network link to a robot, measured over `seconds`: how many of
    its states arrived, how many were lost, and delays [ms].

    `in_a_row` is the most states lost in a row; `late_ms` the 99.9th percentile of the
    times between two arrivals, `worst_ms` the longest.
    """

    seconds: float
    states: int
    lost: int
    in_a_row: int
    late_ms: float
    worst_ms: float

    @property
    def lost_share(self) -> float:
        """Fraction of the robot's states that did not arrive, from 0 to 1."""
        return self.lost / max(self.states + self.lost, 1)


def network(address: str, seconds: float) -> Check:
    """Check whether the states that the robot at `address` sends arrive in time,
    measured over `seconds`.
    """
    try:
        return judge_link(measure_link(address, seconds))
    except CellError as error:
        remedy = "close other programs that hold the robot; check cable and address"
        return Check(
            name="network", state=FAIL, found=str(error), why=NETWORK_WHY, remedy=remedy
        )


def judge_link(link: NetworkLink) -> Check:
    """Check whether few of the robot's states are lost on a measured network `link`,
    and none arrive late.
    """
    remedy = (
        "connect the robot to a network card of its own, without a switch; switch off"
        " power saving of processor and card; close busy programs"
    )
    found = (
        f"{link.states} states in {link.seconds:.0f} s, {100 * link.lost_share:.2f} %"
        f" lost, at most {link.in_a_row} in a row; 99.9 % within {link.late_ms:.1f} ms,"
        f" worst {link.worst_ms:.1f} ms"
    )
    state = PASS
    if link.lost_share > LOST_SHARE or link.late_ms > LARGEST_DELAY_MS:
        state = WARN
    if link.lost_share > TOO_MANY or link.in_a_row >= IN_A_ROW:
        state = FAIL
    return Check(
        name="network", state=state, found=found, why=NETWORK_WHY, remedy=remedy
    )


def measure_link(address: str, seconds: float) -> NetworkLink:
    """Measure the network link to the robot at `address` over `seconds`; CellError
    where the robot cannot be reached.

    In a process of its own: reading blocks, and the client library changes the
    scheduler of the process that connects.
    """
    child = Child(_read_states, address, seconds)
    try:
        link: NetworkLink | None = child.receive(seconds + STARTING)
    except ChildDied as died:
        text = str(died) if died.failure is None else died.failure.text
        raise CellError(f"{address}: {' '.join(text.split())[:200]}") from None
    finally:
        child.kill()
    if link is None:
        raise CellError(f"{address}: no answer within {seconds + STARTING:.0f} s")
    return link


def _read_states(pipe: Connection, address: str, seconds: float) -> None:
    """Read the robot's states for `seconds` and send statistics on them through `pipe`,
    as the main function of a process.
    """
    import pylibfranka as franka

    robot = franka.Robot(address, franka.RealtimeConfig.kIgnore)
    times: list[int] = []
    arrivals: list[float] = []
    until = time.monotonic() + seconds + BUFFERED
    while not arrivals or arrivals[-1] < until:
        state = robot.read_once()
        arrivals.append(time.monotonic())
        times.append(round(1e3 * state.time.to_sec()))
    pipe.send(link_of(np.array(times), np.array(arrivals)))


def link_of(times: NDArray[np.int64], arrivals: Array) -> NetworkLink:
    """Statistics of a network link from the clock `times` [ms] of the robot's states
    and their `arrivals` [s], both of shape (states,).

    The time BUFFERED at the start does not count: what waits in a buffer arrives at
    once.
    """
    kept = arrivals > arrivals[0] + BUFFERED
    times, arrivals = times[kept], arrivals[kept]
    missing = np.maximum(np.diff(times) - 1, 0)
    apart = 1e3 * np.diff(arrivals)
    return NetworkLink(
        seconds=float(arrivals[-1] - arrivals[0]),
        states=len(times),
        lost=int(missing.sum()),
        in_a_row=int(missing.max(initial=0)),
        late_ms=float(np.percentile(apart, 99.9)),
        worst_ms=float(apart.max(initial=0.0)),
    )
