"""Studies as values: question, cases, measurement of a case, statistics over cases."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from scipy.stats import binomtest

from cell.base.campaign.journal import digest
from drivers.base.types import Array

CONFIDENCE_LEVEL = 0.95
DRAWS = 1000  # of the bootstrap


class Statistic(Enum):
    """Statistics of many values (n,), each with its name in a table; `| |` is of their
    size.
    """

    MEAN = "mean", np.mean
    MEDIAN = "median", np.median
    RMS = "rms", lambda values: np.sqrt(np.mean(np.square(values)))
    SIGMA = "sigma", np.std
    MEAN_SIZE = "mean | |", lambda values: np.mean(np.abs(values))
    P95_SIZE = "95 % | |", lambda values: np.quantile(np.abs(values), 0.95)
    WORST_SIZE = "worst | |", lambda values: np.max(np.abs(values))
    SHARE = "share", np.mean
    COUNT = "count", np.sum

    def __call__(self, values: Array) -> float:
        """Compute the statistic of values (n,); NaN of none."""
        return float(self.value[1](values)) if values.size else float("nan")


# of these very cases: without an interval
EXACT_STATISTICS = (Statistic.WORST_SIZE, Statistic.COUNT)


@dataclass(frozen=True, slots=True)
class Quantity:
    """Column of a table: the `statistic` of each outcome's `value`, one number or a
    list.

    Shown times `scale` in `unit`; the `bar` is the most that it may be, in that unit,
    or the least where `floor`; `end` is the most that its interval may reach. `label`
    replaces the name.
    """

    value: str
    statistic: Statistic
    unit: str = "mm"
    scale: float = 1e3
    bar: float | None = None
    floor: bool = False
    label: str = ""
    digits: int = 2
    end: float = np.inf

    @property
    def title(self) -> str:
        """Head of the quantity's column."""
        name = self.label or f"{self.statistic.value[0]} {self.value}"
        return f"{name} [{self.unit}]" if self.unit else name


def percentage(
    value: str, label: str = "", bar: float | None = None, *, floor: bool = True
) -> Quantity:
    """Share of the cases whose `value` is true, in whole %, which is at least the `bar`
    or, without `floor`, at most.
    """
    at_least = floor and bar is not None
    return Quantity(value, Statistic.SHARE, "%", 100.0, bar, at_least, label, 0)


@dataclass(frozen=True, slots=True)
class Figure:
    """Value of a quantity with its 95 % interval, NaN without one, and the `count` of
    its cases.

    `held` states whether the value keeps its bar, None without a bar.
    """

    quantity: Quantity
    value: float
    low: float
    high: float
    count: int
    held: bool | None = field(default=None)

    def text(self) -> str:
        """The number as text, with its interval where it has one."""
        if not np.isfinite(self.value):
            return "-"
        digits = self.quantity.digits
        text = f"{self.value:.{digits}f}"
        if np.isfinite(self.low):
            text += f" ({self.low:.{digits}f} to {self.high:.{digits}f})"
        return text + {None: "", True: "", False: " over its bar"}[self.held]


def figure(quantity: Quantity, samples: Sequence[Sequence[float]]) -> Figure:
    """Compute `quantity` over the `samples` of each case, which may be none.

    The interval of a share is exact (Clopper and Pearson), the others' a bootstrap over
    cases, since the samples of one case belong together.
    """
    cases = [np.asarray(each, dtype=np.float64) for each in samples]
    cases = [each[np.isfinite(each)] for each in cases]
    cases = [each for each in cases if each.size]
    values = np.concatenate(cases) if cases else np.zeros(0)
    low, high = _interval(quantity.statistic, cases, values)
    scale = quantity.scale
    value = scale * quantity.statistic(values)
    held = _keeps_bar(quantity, value, scale * high)
    return Figure(quantity, value, scale * low, scale * high, len(cases), held)


def _keeps_bar(quantity: Quantity, value: float, high: float) -> bool | None:
    """Whether `value`, its interval up to `high`, keeps the quantity's bar; None
    without a bar or without a number.
    """
    if quantity.bar is None or not np.isfinite(value):
        return None
    if high > quantity.end:
        return False
    return value >= quantity.bar if quantity.floor else value <= quantity.bar


def _interval(
    statistic: Statistic, cases: list[Array], values: Array
) -> tuple[float, float]:
    """95 % interval of a statistic: exact for shares, else by bootstrap over cases."""
    if len(cases) < 2 or statistic in EXACT_STATISTICS:
        return float("nan"), float("nan")
    if statistic is Statistic.SHARE and values.size == len(cases):
        exact = binomtest(int(values.sum()), len(values)).proportion_ci(
            CONFIDENCE_LEVEL
        )
        return float(exact.low), float(exact.high)
    rng = np.random.default_rng(0)
    draws = rng.integers(len(cases), size=(DRAWS, len(cases)))
    if values.size == len(cases):
        found = [statistic(values[draw]) for draw in draws]
    else:
        found = [statistic(np.concatenate([cases[i] for i in draw])) for draw in draws]
    tail = (1 - CONFIDENCE_LEVEL) / 2
    low, high = np.quantile(found, (tail, 1 - tail))
    return float(low), float(high)


Values = Mapping[str, Any]
"""Plain JSON by name."""
Draw = Callable[[int, np.random.Generator], Values]
"""Draws a case from its number and its own generator."""
Measure = Callable[[Values], Values]
"""Function of a module from the values of a case to those of its outcome."""


@dataclass(frozen=True, slots=True)
class Case:
    """Case `number` of a study with its values, plain JSON, and the seed that it was
    drawn from.
    """

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
    """Data file of the package that a study writes to `path`, with content `of` all
    outcomes.

    The path is in the checkout; to the content's `source`, if any, the number of cases
    is added.
    """

    path: str
    of: Callable[[Sequence[Outcome]], Values]


@dataclass(frozen=True, slots=True)
class Study:
    """A study: how its cases are drawn and measured, and the columns of its table.

    `draw` makes case number i from a generator of its own, seeded by (seed, i), so that
    a larger study holds the smaller one. `measure` takes the values of a case to those
    of its outcome; both are functions of a module, so that another process can call
    them. `usual` and `quick` are numbers of cases, the latter 0 where one takes
    minutes; `seconds` is the processor time of one, `limit` the wall time at which it
    is set aside [s]. Rows of the table are groups of cases with equal values of `by`.
    Cases that fail, or are set aside, count with the values `failed`. `command` measures
    the same cases again.
    """

    name: str
    question: str
    draw: Draw
    measure: Measure
    quantities: tuple[Quantity, ...]
    usual: int
    quick: int
    by: tuple[str, ...] = ()
    seconds: float = 10.0
    limit: float = 1800.0
    fits: tuple[Fit, ...] = ()
    failed: Callable[[Values], Values] = lambda _: {}
    command: str = "study {name} --seed {seed} --count {count}"

    def cases(self, seed: int, count: int) -> tuple[Case, ...]:
        """The first `count` cases drawn by `seed`."""
        return tuple(
            Case(number, seed, self.draw(number, np.random.default_rng([seed, number])))
            for number in range(count)
        )
