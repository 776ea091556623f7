"""Settings of a run for the selected arm; for a real robot consent, slow motion, a laid
strip.
"""

from collections.abc import Callable, Iterable
from typing import TypeVar

from cell.base.config.cell import CellFile
from cell.base.config.settings import CellSettings, FoldSettings
from cell.base.devices.devices import Trial
from cell.setup.doctor.check import Check
from cell.setup.doctor.doctor import motion_checks, refuse_failed
from drivers.base.errors import PreflightRefused
from drivers.base.installation import MotionLimits
from drivers.base.settings import parse

S = TypeVar("S", bound=CellSettings)
FIRST_RUN_SPEED = 0.1  # share of the configured speeds at which first runs are made
LEAST_SPEED = 0.005  # m/s, the least that FoldSettings allows
# s, that a slow run may be given
TIME_LIMITS = {"duration": 900.0, "state_duration": 300.0}


def consent(
    settings: CellFile, ask: Callable[[str], str], checks: Iterable[Check]
) -> bool:
    """Have the operator agree that a real robot moves, by typing the cell's name, once
    all of `checks` have passed.

    Returns whether a real robot may move: False for another arm. Raises
    PreflightRefused where a check failed or the name was not typed.
    """
    refuse_failed(checks)
    if not settings.has_real_arm:
        return False
    question = (
        f"A real robot will move. Type the cell's name ({settings.name}) to go on: "
    )
    if ask(question).strip() != settings.name:
        raise PreflightRefused(
            f"the cell's name was not typed; nothing has moved; type {settings.name!r}"
            " when asked"
        )
    return True


def agree_to_slow_motion(
    settings: CellFile,
    ask: Callable[[str], str],
    *,
    full_speed: bool,
    checked: bool = True,
    camera: bool = False,
) -> tuple[CellFile, Trial]:
    """Settings of the cell, with a first run's speeds for a real robot unless
    `full_speed`, and the operator's consent, for a motion by hand or a calibration.

    The doctor checks a real robot first unless `checked` is false, and the `camera` if
    asked.
    """
    checks = motion_checks(settings, camera=camera) if checked else ()
    trial = Trial(agreed=consent(settings, ask, checks))
    if trial.agreed and not full_speed:
        settings = slow_down(settings)
    return settings, trial


def await_strip(ask: Callable[[str], str]) -> None:
    """Wait until the operator says that the strip lies flat again; raises
    PreflightRefused where the input ends before that.
    """
    if not ask("Lay the strip again, flat and straight, then press Enter: "):
        raise PreflightRefused(
            "the input ended before Enter was pressed: nobody says that the strip lies"
            " there and all keep clear; nothing has moved since the last fold"
        )


def slow_down(settings: CellFile) -> CellFile:
    """Copy of the cell's settings for a first run: all speeds are a fixed fraction of
    those before, those of the fold at least LEAST_SPEED, and time limits are longer.
    """
    fold = settings.fold.model_copy(
        update={
            "speed": max(FIRST_RUN_SPEED * settings.fold.speed, LEAST_SPEED),
            "lay_speed": max(FIRST_RUN_SPEED * settings.fold.lay_speed, LEAST_SPEED),
        }
    )
    axes = {
        name: axis.model_copy(update={"velocity": FIRST_RUN_SPEED * axis.velocity})
        for name, axis in zip(
            ("x", "z", "pitch"), settings.installation.limits.axes, strict=True
        )
    }
    installation = settings.installation.model_copy(
        update={"limits": MotionLimits(**axes)}
    )
    times = {
        name: min(getattr(settings.monitors, name) / FIRST_RUN_SPEED, longest)
        for name, longest in TIME_LIMITS.items()
    }
    monitors = settings.monitors.model_copy(update=times)
    return settings.model_copy(
        update={"fold": fold, "installation": installation, "monitors": monitors}
    )


def at_speed(settings: S, speed: float | None) -> S:
    """Copy of the cell's settings with the speed `speed` [m/s] along the path; where it
    is None, the settings are unchanged.

    Raises ConfigurationError for a speed outside its limits.
    """
    if speed is None:
        return settings
    content = settings.fold.model_dump() | {"speed": speed}
    return settings.model_copy(update={"fold": parse(content, FoldSettings, "fold")})


def limit_to_arm(settings: CellFile) -> CellFile:
    """Copy of the cell's settings with limits of motion that its arm can keep, and with
    the kind of start, flat or hanging, that suits the arm.

    The start is `fold.start` where that is stated. If not, a run of the in-process arm
    begins flat: it follows the lift as planned, so that a model can repeat it. That of
    a robot, whose own limits and reach bend its lift, begins once the strip hangs.
    """
    is_robot = settings.arm_driver.real
    installation = (
        settings.fci.limit(settings.installation) if is_robot else settings.installation
    )
    start = settings.fold.start or ("hanging" if is_robot else "flat")
    fold = settings.fold.model_copy(update={"start": start})
    return settings.model_copy(update={"installation": installation, "fold": fold})
