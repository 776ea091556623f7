"""A study as a value: its question, its cases, the measurement of one, the statistics of all."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cell.campaign.journal import digest
from cell.campaign.statistic import Quantity

Values = Mapping[str, Any]
"""Plain JSON by name."""
Draw = Callable[[int, np.random.Generator], Values]
"""Draws a case from its number and its own generator."""


@dataclass(frozen=True, slots=True)
class Case:
    """Case `number` of a study with its values, plain JSON, and the seed that it was drawn from."""

    number: int
    seed: int
    values: Values

    @property
    def key(self) -> str:
        """Name of the case in the journal."""
        return f"{self.number:05d}-{digest(repr(sorted(self.values.items())))}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """Measurement of a case; `values` are plain JSON."""

    case: Case
    values: Values


@dataclass(frozen=True, slots=True)
class Fit:
    """Data file of the package that a study writes to `path`, with content `of` all outcomes.

    The path is in the checkout; to the content's `source`, if any, the number of cases is added.
    """

    path: str
    of: Callable[[Sequence[Outcome]], Values]


@dataclass(frozen=True, slots=True)
class Ledger:
    """Page of the checkout that a study writes to `path`, with text `of` all outcomes."""

    path: str
    of: Callable[[Sequence[Outcome]], str]


@dataclass(frozen=True, slots=True)
class Study:
    """A study: how its cases are drawn and measured, and the columns of its table.

    `draw` makes case number i from a generator of its own, seeded by (seed, i), so that a larger
    study holds the smaller one. `measure` takes the values of a case to those of its outcome; both
    are functions of a module, so that another process can call them. `usual` and `quick` are
    numbers of cases, the latter 0 where one takes minutes; `seconds` is the processor time of one,
    `limit` the wall time at which it is set aside [s]. Rows of the table are groups of cases with
    equal values of `by`.
    """

    name: str
    question: str
    draw: Draw
    measure: Callable[[Values], Values]
    quantities: tuple[Quantity, ...]
    usual: int
    quick: int
    by: tuple[str, ...] = ()
    seconds: float = 10.0
    limit: float = 1800.0
    fits: tuple[Fit, ...] = ()
    ledger: Ledger | None = None

    def cases(self, seed: int, count: int) -> tuple[Case, ...]:
        """The first `count` cases drawn by `seed`."""
        return tuple(
            Case(number, seed, self.draw(number, np.random.default_rng([seed, number])))
            for number in range(count)
        )
