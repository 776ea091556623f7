"""Checks that `cell doctor` and each motion of a real robot make, and refusal where one fails."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from cell.config.cell import CellFile
from cell.config.places import Configs
from cell.devices.devices import DeviceSelection
from cell.devices.open import is_real, robot_address
from cell.doctor import devices, machine
from cell.doctor.check import Check, Grade
from drivers.errors import CellError, PreflightRefused

ASKED, BRIEF = 60.0, 2.0  # s of the network's test: by the doctor, and before each real session


def checks(
    configs: Configs, choice: DeviceSelection, runs: Path, seconds: float = ASKED
) -> Iterator[Check]:
    """Yield all checks that the configured hardware needs; the network's takes `seconds`."""
    yield machine.versions()
    yield machine.extras()
    why = "nothing is done by a file that cannot be read"
    try:
        settings = configs.cell()
        names = configs.strip_names()
        for name in names:
            configs.strip(name)
    except CellError as error:
        yield Check("configuration", Grade.FAIL, str(error), why, "mend the file that is named")
        return
    found = f"{settings.name}, {len(names)} strips in {configs.folder}"
    yield Check("configuration", Grade.PASS, found, why)
    yield from hardware_checks(settings, choice, runs, seconds)


def hardware_checks(
    settings: CellFile, choice: DeviceSelection, runs: Path, seconds: float = ASKED
) -> Iterator[Check]:
    """Yield the checks of machine, calibration, robot, camera; the network's takes `seconds`."""
    yield machine.disk(runs)
    yield machine.cores()
    has_real_camera = choice.camera_driver(settings).real
    yield devices.calibration(settings, on_twin=not has_real_camera)
    yield from _arm(settings, choice, seconds)
    if has_real_camera:
        yield devices.camera(settings, choice)
    else:
        yield Check("camera", Grade.SKIPPED, "the twin's", "there is nothing to connect")


def _arm(settings: CellFile, choice: DeviceSelection, seconds: float) -> Iterator[Check]:
    """Yield the checks of a robot, its kernel settings and network, up to the first that fails."""
    address = robot_address(settings, choice)
    if address is None:
        yield Check("robot", Grade.SKIPPED, "none at fci.address", "there is nothing to connect")
        return
    installed = devices.library()
    yield installed
    if is_real(settings, choice):
        yield machine.kernel(settings.fci.realtime)
        yield machine.priority(settings.fci.realtime)
        yield machine.throttling()
    if installed.state is Grade.PASS:
        answering = devices.robot(address)
        yield answering
        if answering.state is Grade.PASS:
            yield devices.network(address, seconds)


def motion_checks(
    settings: CellFile, choice: DeviceSelection, *, camera: bool = False
) -> Iterator[Check]:
    """Yield each check that a motion of a real robot by hand needs; none for another arm.

    With `camera` a real camera is checked, too.
    """
    if not is_real(settings, choice):
        return
    yield machine.versions()
    yield machine.cores()
    yield from _arm(settings, choice, BRIEF)
    if camera and choice.camera_driver(settings).real:
        yield devices.camera(settings, choice)


def refuse_failed(found: Iterable[Check]) -> None:
    """Raise PreflightRefused where one of the checks `found` has failed."""
    red = [check for check in found if check.state is Grade.FAIL]
    if red:
        lines = "\n".join(f"{check.name}: {check.found}; {check.remedy}" for check in red)
        raise PreflightRefused(f"{lines}\nnothing has moved; `cell doctor` says more")
