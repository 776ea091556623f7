"""What a robot that can hurt demands: its cell named, slow motion first, a strip laid again."""

from collections.abc import Callable
from ipaddress import ip_address

from cell.config.cell import CellFile
from cell.devices.devices import DeviceSelection
from drivers.errors import PreflightRefused
from drivers.limits import MotionLimits

FIRST_RUN_SPEED = 0.1  # share of the speed of first runs
TIME_LIMITS = {"duration": 900.0, "state_duration": 300.0}  # s, that a slow run may be given


def is_real(settings: CellFile, choice: DeviceSelection) -> bool:
    """Whether the chosen arm is a physical robot, not one emulated on this machine."""
    address = settings.fci.address
    if not choice.arm_driver(settings).real or address is None:
        return False
    try:
        return not ip_address(address).is_loopback
    except ValueError:
        return address != "localhost"


def confirm(settings: CellFile, ask: Callable[[str], str]) -> None:
    """Have the operator type the cell's name before the first motion.

    Raises PreflightRefused where it was not typed.
    """
    question = f"A real robot will move. Type the cell's name ({settings.name}) to go on: "
    try:
        typed = ask(question).strip()
    except EOFError:
        typed = ""
    if typed != settings.name:
        raise PreflightRefused(
            f"the cell's name was not typed; nothing has moved; type {settings.name!r} when asked"
        )


def slow_down(settings: CellFile) -> CellFile:
    """The cell with all speeds at FIRST_RUN_SPEED, and the time that a run then needs."""
    fold = settings.fold.model_copy(
        update={
            "speed": max(FIRST_RUN_SPEED * settings.fold.speed, 0.005),
            "lay_speed": max(FIRST_RUN_SPEED * settings.fold.lay_speed, 0.005),
        }
    )
    axes = {
        name: axis.model_copy(update={"velocity": FIRST_RUN_SPEED * axis.velocity})
        for name, axis in zip(("x", "z", "pitch"), settings.installation.limits.axes, strict=True)
    }
    installation = settings.installation.model_copy(update={"limits": MotionLimits(**axes)})
    times = {
        name: min(getattr(settings.monitors, name) / FIRST_RUN_SPEED, longest)
        for name, longest in TIME_LIMITS.items()
    }
    monitors = settings.monitors.model_copy(update=times)
    return settings.model_copy(
        update={"fold": fold, "installation": installation, "monitors": monitors}
    )
