"""Events of a run as recorded: changes of state, start of measured time, policy's
predictions.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf, nan
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from cell.record.columns import LARGEST_VALUE
from cell.record.files import EVENTS
from drivers.base.readers import read_json_lines
from drivers.base.types import Array

# kinds of events
ORIGIN = "origin"  # at t = 0 of the run's tables
LIFT = "lift"  # at t = 0 of its streams and images, where that is another moment
PREDICTED = "foretold"  # with a prediction by the policy
NOT_LEARNED = "not_learned"  # of a fold whose deviation could not be stored
EVERY_FRAME = frozenset({"decision", PREDICTED})  # kinds that are too many for a log
BELIEFS = ("bending_length", "retardation_time", "yield_curvature")
COLUMN_NAMES = tuple(
    name + end for name in ("displacement", *BELIEFS) for end in ("", "_low", "_high")
)
"""Columns of a row: displacement [m] with one sigma about it, then bending length [m],
retardation time [s] and yield curvature [1/m] with their intervals.
"""


@dataclass(frozen=True, slots=True)
class Event:
    """Event of a run at `t` [s]: its `kind` and its `facts`."""

    t: float
    kind: str
    facts: Mapping[str, Any]


def read_events(folder: Path) -> tuple[Event, ...]:
    """Events of the run in `folder` in the order of writing, `t` on the cell's
    clock.
    """
    lines = read_json_lines(folder / EVENTS)
    return tuple(
        Event(
            _number(line.pop("t", None), otherwise=0.0), str(line.pop("kind", "")), line
        )
        for line in lines
    )


def log_text(kind: str, facts: Mapping[str, Any]) -> str:
    """One line of text on an event of this `kind` with these `facts`, for a log."""
    if set(facts) == {"state", "event"}:
        return f"{facts['state']}, after {facts['event']}"
    text = ", ".join([kind, *(f"{key} {value}" for key, value in facts.items())])
    return text if len(text) <= 300 else f"{text[:297]}..."


def origin_of(events: Iterable[Event]) -> float:
    """Time [s] of the cell's clock at t = 0 of the run; 0 where no event states it."""
    return next((event.t for event in events if event.kind == ORIGIN), 0.0)


def lift_time(folder: Path) -> float:
    """Time [s] from the start of the streams in `folder` to t = 0 of the run.

    0 for a run that starts flat; infinite for one that ended before it hung still.
    """
    times = {event.kind: event.t for event in reversed(read_events(folder))}
    return times.get(ORIGIN, inf) - times[LIFT] if LIFT in times else 0.0


class Outlook(NamedTuple):
    """Policy's predictions during a fold: `rows` (k, len(COLUMN_NAMES)) at times `t`
    (k,) [s].
    """

    t: Array
    rows: Array

    @classmethod
    def from_events(cls, events: Iterable[Event]) -> Self:
        """Collect the policy's predictions in `events`; NaN for values that cannot be
        read.
        """
        stated = sorted(
            (e for e in events if e.kind == PREDICTED), key=lambda event: event.t
        )
        rows = np.array([row_of(event.facts) for event in stated])
        return cls(
            np.array([event.t for event in stated]), rows.reshape(-1, len(COLUMN_NAMES))
        )

    def band(self, name: str) -> Array:
        """Predicted values of the quantity `name` and their bounds (3, k)."""
        place = COLUMN_NAMES.index(name)
        return self.rows[:, place : place + 3].T


def row_of(facts: Mapping[str, object]) -> Array:
    """Values (k,) of one prediction, one for each of the k COLUMN_NAMES, from its
    event's facts.
    """
    displacement, sigma = (
        _number(facts.get(name)) for name in ("displacement", "sigma")
    )
    row = [displacement, displacement - sigma, displacement + sigma]
    for name in BELIEFS:
        stated = facts.get(name)
        known = stated if isinstance(stated, Mapping) else {}
        row += [_number(known.get(key)) for key in ("value", "low", "high")]
    return np.array(row)


def _number(value: object, otherwise: float = nan) -> float:
    """`value` as a float, or `otherwise` where it is no number or exceeds
    LARGEST_VALUE.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return otherwise
    return float(value) if abs(value) <= LARGEST_VALUE else otherwise
