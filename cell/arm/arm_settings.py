"""Adaptation of the cell's settings to the speed and the arm of one run."""

from cell.arm.real_robot import slow_down
from cell.config.cell import CellFile
from cell.config.settings import FoldSettings
from cell.devices.devices import DeviceSelection
from cell.devices.open import is_real
from drivers.settings import parse


def settings_of_run(
    settings: CellFile, choice: DeviceSelection, speed: float | None, *, full_speed: bool
) -> CellFile:
    """The cell's settings for a run at path `speed` [m/s], if given, with the chosen arm.

    A real robot is slowed down, unless at `full_speed`.
    """
    settings = at_speed(settings, speed)
    if is_real(settings, choice) and not full_speed:
        settings = slow_down(settings)
    return suit_to_arm(settings, choice)


def at_speed(settings: CellFile, speed: float | None) -> CellFile:
    """Copy of the cell's settings with path speed `speed` [m/s]; unchanged if it is None.

    Raises ConfigurationError for a speed outside its limits.
    """
    if speed is None:
        return settings
    content = settings.fold.model_dump() | {"speed": speed}
    return settings.model_copy(update={"fold": parse(content, FoldSettings, "fold")})


def suit_to_arm(settings: CellFile, choice: DeviceSelection) -> CellFile:
    """The cell's settings with the limits of the chosen arm and its start of measured time.

    The start is `fold.start` where that is stated. If not, a run of the in-process arm begins flat:
    it follows the lift as planned, so that a model can repeat it. That of a robot, whose own limits
    and reach bend its lift, begins once the strip hangs.
    """
    is_robot = choice.arm_driver(settings).real
    changes: dict[str, object] = {}
    if is_robot:
        changes["installation"] = settings.fci.limit(settings.installation)
    if settings.fold.start is None:
        start = "hanging" if is_robot else "flat"
        changes["fold"] = settings.fold.model_copy(update={"start": start})
    return settings.model_copy(update=changes)
