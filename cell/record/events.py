"""Events of a run on the cell's clock, and the origin of its measured time among them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import Any

from cell.record.files import EVENTS
from drivers.readers import read_json_lines

ORIGIN = "origin"  # kind of the event at t = 0 of the run's tables
LIFT = "lift"  # of that at t = 0 of its streams and images, where that is another moment
LATEST = 1e9  # s, of an event


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a run at `t` [s]: its `kind` and its `facts`."""

    t: float
    kind: str
    facts: Mapping[str, Any]


def read_events(folder: Path) -> tuple[Event, ...]:
    """Events of the run in `folder` in the order of writing, with `t` on the cell's clock."""
    lines = read_json_lines(folder / EVENTS)
    return tuple(
        Event(_time(line.pop("t", None)), str(line.pop("kind", "")), line) for line in lines
    )


def origin_of(events: Iterable[Event]) -> float:
    """Cell's clock [s] at t = 0 of the run; 0 where the events do not state it."""
    return next((event.t for event in events if event.kind == ORIGIN), 0.0)


def lift_time(folder: Path) -> float:
    """Time [s] from the start of the streams in `folder` to t = 0 of the run.

    0 for a run that starts flat; infinite for one that ended before it hung still.
    """
    times = {event.kind: event.t for event in reversed(read_events(folder))}
    return times.get(ORIGIN, inf) - times[LIFT] if LIFT in times else 0.0


def _time(value: object) -> float:
    """Time [s] that an event states as `value`; 0 for a value that is no time."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return 0.0
    return float(value) if isfinite(value) and abs(value) < LATEST else 0.0
