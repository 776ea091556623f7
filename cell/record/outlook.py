"""A policy's predictions during a fold, read from the record's events."""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple, Self

import numpy as np

from cell.record.columns import LARGEST_VALUE
from cell.record.events import Event
from drivers.types import Array

PREDICTED = "foretold"  # kind of the events
BELIEFS = ("bending_length", "retardation_time", "yield_curvature")
COLUMN_NAMES = tuple(
    name + end for name in ("displacement", *BELIEFS) for end in ("", "_low", "_high")
)
"""Columns of a row: displacement [m] with one sigma about it, then bending length [m], retardation
time [s] and yield curvature [1/m] with their intervals."""


class Outlook(NamedTuple):
    """Predictions of a fold: `rows` (k, len(COLUMN_NAMES)) at times `t` (k,) [s] from the lift."""

    t: Array
    rows: Array

    @classmethod
    def of(cls, events: Iterable[Event]) -> Self:
        """Collect the predictions among `events`; NaN for values that cannot be read."""
        stated = sorted((e for e in events if e.kind == PREDICTED), key=lambda event: event.t)
        rows = np.array([row_of(event.facts) for event in stated])
        return cls(np.array([event.t for event in stated]), rows.reshape(-1, len(COLUMN_NAMES)))

    def column(self, name: str) -> Array:
        """Values (k,) of the prediction's column `name`."""
        return np.asarray(self.rows[:, COLUMN_NAMES.index(name)])


def row_of(facts: Mapping[str, object]) -> Array:
    """Row (k,) of one prediction with a value for each of COLUMN_NAMES, from an event's facts."""
    displacement, sigma = (_number(facts.get(name)) for name in ("displacement", "sigma"))
    row = [displacement, displacement - sigma, displacement + sigma]
    for name in BELIEFS:
        stated = facts.get(name)
        known = stated if isinstance(stated, Mapping) else {}
        row += [_number(known.get(key)) for key in ("value", "low", "high")]
    return np.array(row)


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > LARGEST_VALUE:
        return math.nan
    return float(value)
