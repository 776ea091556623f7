"""Origin of a run's measured time, from its events on the cell's clock."""

from collections.abc import Iterable, Mapping
from math import inf, isfinite
from pathlib import Path
from typing import Any

from cell.record.files import EVENTS
from drivers.readers import read_json_lines

ORIGIN = "origin"  # t = 0 of the run's tables
LIFT = "lift"  # t = 0 of its streams and images, where that is another moment
LATEST = 1e9  # s, of an event


def origin_of(lines: Iterable[Mapping[str, Any]]) -> float:
    """Cell's clock [s] at t = 0 of the run; 0 where the events do not state it."""
    begins = _moments(lines, ORIGIN)
    return begins[0] if begins else 0.0


def lift_time(folder: Path) -> float:
    """Time [s] from the start of the streams in `folder` to t = 0 of the run.

    0 for a run that starts flat; infinite for one that ended before it hung still.
    """
    lines = read_json_lines(folder / EVENTS)
    lifts, begins = _moments(lines, LIFT), _moments(lines, ORIGIN)
    if not lifts:
        return 0.0
    return begins[0] - lifts[0] if begins else inf


def moment(value: object) -> float:
    """Time [s] that an event states as `value`; 0 for a value that is no time."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return 0.0
    return float(value) if isfinite(value) and abs(value) < LATEST else 0.0


def _moments(lines: Iterable[Mapping[str, Any]], kind: str) -> list[float]:
    return [moment(line.get("t")) for line in lines if line.get("kind") == kind]
