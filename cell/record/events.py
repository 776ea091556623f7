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
    """Event of a run, such as a change of state, at the time `t` [s]: its `kind`, and
    `facts` about it by name.
    """

    t: float
    kind: str
    facts: Mapping[str, Any]


def read_events(folder: Path) -> tuple[Event, ...]:
    """Events of the run in `folder`, in the order in which they were written, with
    times [s] on the clock of the cell.
    """
    lines = read_json_lines(folder / EVENTS)
    return tuple(
        Event(
            _number(line.pop("t", None), otherwise=0.0), str(line.pop("kind", "")), line
        )
        for line in lines
    )


def log_text(kind: str, facts: Mapping[str, Any]) -> str:
    """Line of text for a log on an event of the given `kind` with the given `facts`."""
    if set(facts) == {"state", "event"}:
        return f"{facts['state']}, after {facts['event']}"
    text = ", ".join([kind, *(f"{key} {value}" for key, value in facts.items())])
    return text if len(text) <= 300 else f"{text[:297]}..."


def origin_of(events: Iterable[Event]) -> float:
    """Time [s], on the clock of the cell, at which the time of the run is zero; 0 where
    none of `events` states it.
    """
    return next((event.t for event in events if event.kind == ORIGIN), 0.0)


def lift_time(folder: Path) -> float:
    """Time [s] from the first recorded row of the run in `folder` to the moment at
    which the time of the run is zero.

    0 for a run that starts flat; infinite for one that ended before it hung still.
    """
    times = {event.kind: event.t for event in reversed(read_events(folder))}
    return times.get(ORIGIN, inf) - times[LIFT] if LIFT in times else 0.0


class Outlook(NamedTuple):
    """What a policy predicted during a fold: a row of predicted values and their bounds
    for each of the times `t` [s].
    """

    t: Array
    rows: Array

    @classmethod
    def from_events(cls, events: Iterable[Event]) -> Self:
        """Predictions of a policy that are recorded in `events`; a value that cannot be
        read is NaN.
        """
        stated = sorted(
            (e for e in events if e.kind == PREDICTED), key=lambda event: event.t
        )
        rows = np.array([row_of(event.facts) for event in stated])
        return cls(
            np.array([event.t for event in stated]), rows.reshape(-1, len(COLUMN_NAMES))
        )

    def band(self, name: str) -> Array:
        """Predictions of the quantity called `name`, as an array of shape (3, times):
        the values, their lower bounds, and their upper bounds.
        """
        place = COLUMN_NAMES.index(name)
        return self.rows[:, place : place + 3].T


def row_of(facts: Mapping[str, object]) -> Array:
    """Values of one prediction with their bounds, as an array of shape (columns,), from
    the `facts` of its event, in the order of the columns of an Outlook.
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
    """Number `value` as a float, or `otherwise` where it is no number or too large."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return otherwise
    return float(value) if abs(value) <= LARGEST_VALUE else otherwise
