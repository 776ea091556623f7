"""Checks that `cell doctor` and each motion of a real robot make, and refusal where one
fails.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path

from cell.base.config.cell import CellFile
from cell.base.config.places import Configs
from cell.setup.doctor import devices, machine
from cell.setup.doctor.check import FAIL, PASS, SKIPPED, WARN, Check
from drivers.base.errors import CellError, PreflightRefused

# s of the network's test: by the doctor, and before each real session
ASKED, BRIEF = 10.0, 2.0


def checks(
    configs: Configs,
    runs: Path,
    seconds: float = ASKED,
    *,
    arm: str | None = None,
    camera: str | None = None,
) -> Iterator[Check]:
    """Yield all checks of a cell's software and hardware, one after the other; that of
    the network takes `seconds`.

    `arm` and `camera` name drivers in place of those of cell.yaml.
    """
    yield machine.versions()
    yield machine.extras()
    why = "nothing is done by a file that cannot be read"
    try:
        settings = configs.cell().with_drivers(arm, camera)
        names = configs.strip_names()
        for name in names:
            configs.strip(name)
    except CellError as error:
        yield Check(
            name="configuration",
            state=FAIL,
            found=str(error),
            why=why,
            remedy="mend the file that is named",
        )
        return
    found = f"{settings.name}, {len(names)} strips in {configs.folder}"
    yield Check(name="configuration", state=PASS, found=found, why=why)
    yield from hardware_checks(settings, runs, seconds)


def hardware_checks(settings: CellFile, runs: Path, seconds: float) -> Iterator[Check]:
    """Yield the checks of disk, cores, calibration, robot and camera; that of the
    network takes `seconds`.
    """
    yield machine.disk(runs)
    yield machine.cores()
    has_real_camera = settings.camera_driver.real
    yield devices.calibration(settings, on_twin=not has_real_camera)
    yield from _robot_checks(settings, seconds)
    if has_real_camera:
        connected = devices.camera(settings)
        yield connected
        if connected.state in {PASS, WARN}:
            yield devices.camera_stream(settings)
    else:
        yield Check(
            name="camera",
            state=SKIPPED,
            found="the twin's",
            why="there is nothing to connect",
        )


def _robot_checks(settings: CellFile, seconds: float) -> Iterator[Check]:
    """Yield the checks of the robot's library, the kernel, the robot and the network,
    of which the last two need the library.
    """
    realtime = settings.fci.realtime
    address = settings.robot_address
    if address is None:
        yield Check(
            name="robot",
            state=SKIPPED,
            found="none at fci.address",
            why="there is nothing to connect",
        )
        return
    installed = devices.library()
    yield installed
    if settings.has_real_arm:
        yield machine.kernel(realtime)
        yield machine.priority(realtime)
        yield machine.throttling()
        yield machine.governor()
    if installed.state is PASS:
        answering = devices.robot(address)
        yield answering
        if answering.state is PASS:
            yield devices.network(address, seconds)


def motion_checks(settings: CellFile, *, camera: bool) -> Iterator[Check]:
    """Yield each check that a motion of a real robot by hand needs first; none where
    the arm is no real robot.

    With `camera` a real camera is checked, too.
    """
    if not settings.has_real_arm:
        return
    yield machine.versions()
    yield machine.cores()
    yield from _robot_checks(settings, BRIEF)
    if camera and settings.camera_driver.real:
        yield devices.camera(settings)


def refuse_failed(found: Iterable[Check]) -> None:
    """Raise PreflightRefused, with the remedies, where any of the checks `found` has
    failed.
    """
    red = [check for check in found if check.state is FAIL]
    if red:
        lines = "\n".join(
            f"{check.name}: {check.found}; {check.remedy}" for check in red
        )
        raise PreflightRefused(f"{lines}\nnothing has moved; `cell doctor` says more")
