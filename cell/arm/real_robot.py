"""Precautions for a real robot: its operator's consent, slow motion, a strip laid again."""

from collections.abc import Callable
from dataclasses import replace

from cell.config.cell import CellFile
from cell.devices.devices import DeviceSelection
from cell.devices.open import is_real
from drivers.errors import PreflightRefused
from drivers.installation import MotionLimits

FIRST_RUN_SPEED = 0.1  # share of the configured speeds at which first runs are made
LEAST_SPEED = 0.005  # m/s, the least that FoldSettings allows
TIME_LIMITS = {"duration": 900.0, "state_duration": 300.0}  # s, that a slow run may be given


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


def agree(
    settings: CellFile, choice: DeviceSelection, ask: Callable[[str], str], *, full_speed: bool
) -> tuple[CellFile, DeviceSelection]:
    """Have the operator agree to a real robot's motion; returns the settings and selection to use.

    Its speeds are then those of a first run, unless `full_speed`.
    """
    if not is_real(settings, choice):
        return settings, choice
    confirm(settings, ask)
    return settings if full_speed else slow_down(settings), replace(choice, agreed=True)


def await_strip(ask: Callable[[str], str]) -> None:
    """Wait until the operator has laid the strip again.

    Raises PreflightRefused where nobody is there.
    """
    if not ask("Lay the strip again, flat and straight, then press Enter: "):
        raise PreflightRefused(
            "the input ended before Enter was pressed: nobody says that the strip lies there and "
            "all keep clear; nothing has moved since the last fold"
        )


def slow_down(settings: CellFile) -> CellFile:
    """The cell's settings at FIRST_RUN_SPEED of all speeds, with time limits for such a run."""
    fold = settings.fold.model_copy(
        update={
            "speed": max(FIRST_RUN_SPEED * settings.fold.speed, LEAST_SPEED),
            "lay_speed": max(FIRST_RUN_SPEED * settings.fold.lay_speed, LEAST_SPEED),
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
