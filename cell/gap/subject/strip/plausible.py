"""Refuses well-formed runs whose numbers are physically impossible for a fold."""

from pathlib import Path

import numpy as np

from cell.record.files import RESULT, RUN, TICKS
from cell.record.outcomes import is_outcome
from cell.record.run import Run
from drivers.errors import ConfigurationError
from drivers.types import Array

WORST_SIGMA, BEST_SIGMA = 0.05, 1e-7  # m, no instrument of a cell is worse or better
WORST_TIME, BEST_TIME = 1.0, 1e-6  # s
FASTEST_GRIPPER = 5.0  # m/s, faster than any arm
FASTEST_TURN = 30.0  # rad/s, faster than any arm
SHORTEST_INTERVAL = 0.01  # s, over shorter times noise looks like speed
JUMPS = 3  # that may be slips of an instrument
JUMP_SIGMAS = 10  # standard deviations of noise by which positions may differ without motion


def check_plausible(folder: Path, run: Run) -> None:
    """Raise ConfigurationError for a run whose numbers are impossible for a fold."""
    _check_noise(folder / RUN, run)
    if run.result is not None and not is_outcome(run.result.outcome):
        raise ConfigurationError(
            f"{folder / RESULT}: outcome: is {run.result.outcome!r}; allowed: layer_touch, "
            "path_done, or the name of a fault as `cell fold` writes it"
        )
    _check_motion(folder / TICKS, run)


def _check_noise(origin: Path, run: Run) -> None:
    sigma = run.header.sigma
    for key in ("contact_x", "profile", "gripper", "displacement"):
        if key in sigma.model_fields_set:  # it was measured
            value = getattr(sigma, key)
            hint = ", as repeated readings scatter" if value < BEST_SIGMA else ""
            _check_sigma(f"{origin}: sigma.{key}", value, BEST_SIGMA, WORST_SIGMA, "m", hint)
    if sigma.touch_time is not None:
        place = f"{origin}: sigma.touch_time"
        _check_sigma(place, sigma.touch_time, BEST_TIME, WORST_TIME, "s")


def _check_sigma(
    place: str, value: float, best: float, worst: float, unit: str, hint: str = ""
) -> None:
    if not best <= value <= worst:
        limit = f"at most {worst:g}" if value > worst else f"at least {best:g}"
        raise ConfigurationError(
            f"{place}: is {value:g} {unit}, {limit} {unit} is believable; give it in {unit}{hint}"
        )


def _check_motion(origin: Path, run: Run) -> None:
    """Refuse a run whose poses jump between rows, as they do where rows are not sorted by time."""
    ticks = run.ticks
    if len(ticks.t) < 2:
        return
    span = np.maximum(np.diff(ticks.t), SHORTEST_INTERVAL)
    noise = JUMP_SIGMAS * run.header.sigma.gripper
    for names in (("x", "z"), ("x_cmd", "z_cmd")):
        steps = np.hypot(*(np.diff(getattr(ticks, name)) for name in names))
        _check_jumps(origin, ", ".join(names), steps, FASTEST_GRIPPER * span + noise, "m")
    _check_jumps(origin, "pitch", np.abs(np.diff(ticks.pitch)), FASTEST_TURN * span, "rad")


def _check_jumps(origin: Path, names: str, steps: Array, allowed: Array, unit: str) -> None:
    jumps = np.flatnonzero(steps > allowed)
    if len(jumps) > JUMPS:
        row = int(jumps[0]) + 1
        raise ConfigurationError(
            f"{origin}: {names}: {len(jumps)} rows jump, row {row} by {steps[row - 1]:.3g} {unit}, "
            "as no arm moves; sort all columns by t"
        )
