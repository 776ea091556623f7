"""Rates with their uncertainty, and the calibration of stated confidences."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt

NORMAL = 1.959963984540054  # two-sided 95 %


@dataclass(frozen=True, slots=True)
class Rate:
    """A rate: `hits` of `count` cases."""

    hits: int
    count: int

    @property
    def value(self) -> float:
        """Share of hits; NaN without cases."""
        return self.hits / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the rate."""
        return wilson(self.hits, self.count)


def rate(found: Iterable[bool]) -> Rate:
    """Rate of the true values in `found`."""
    every = list(found)
    return Rate(sum(every), len(every))


def wilson(hits: int, count: int, z: float = NORMAL) -> tuple[float, float]:
    """Score interval of a proportion, 0 to 1 of none (Wilson 1927, J. Am. Stat. Assoc. 22, 209)."""
    if count == 0:
        return 0.0, 1.0
    p, spread = hits / count, z * z / count
    middle = (p + spread / 2) / (1 + spread)
    half = z / (1 + spread) * sqrt(p * (1 - p) / count + spread / (4 * count))
    low = 0.0 if hits == 0 else middle - half
    return low, 1.0 if hits == count else middle + half


@dataclass(frozen=True, slots=True)
class Bin:
    """Cases of similar stated confidence: their mean confidence, and how many were right."""

    confidence: float
    right: Rate


def reliability(stated: Sequence[tuple[float, bool]], bins: int = 10) -> list[Bin]:
    """Non-empty bins of confidence, of equal width and in rising order (DeGroot, Fienberg 1983)."""
    groups: dict[int, list[tuple[float, bool]]] = {}
    for confidence, right in stated:
        groups.setdefault(min(int(confidence * bins), bins - 1), []).append((confidence, right))
    return [
        Bin(sum(c for c, _ in group) / len(group), rate(right for _, right in group))
        for _, group in sorted(groups.items())
    ]


def brier(stated: Sequence[tuple[float, bool]]) -> float:
    """Mean squared difference of confidence and outcome (Brier 1950, Mon. Weather Rev. 78, 1)."""
    if not stated:
        return float("nan")
    return sum((confidence - right) ** 2 for confidence, right in stated) / len(stated)


def calibration_error(
    stated: Sequence[tuple[float, bool]], bins: int = 10, counts: Iterable[float] | None = None
) -> float:
    """Mean |confidence - rate| of the bins, by weights (n,) (Naeini, Cooper, Hauskrecht 2015)."""
    away, weights = [0.0] * bins, [1.0] * len(stated) if counts is None else list(counts)
    for (confidence, right), weight in zip(stated, weights, strict=True):
        away[min(int(confidence * bins), bins - 1)] += weight * (confidence - right)
    return sum(map(abs, away)) / sum(weights) if stated else float("nan")


@dataclass(frozen=True, slots=True)
class Confusion:
    """Confusion matrix: counts of each hidden cause (rows) by stated name (columns)."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    counts: dict[tuple[str, str], int]

    def count(self, row: str, column: str) -> int:
        """Number of cases with `row` hidden for which `column` was stated."""
        return self.counts.get((row, column), 0)


def confusion(found: Iterable[tuple[str, str]]) -> Confusion:
    """Count pairs (hidden cause, stated cause) into a confusion matrix.

    Columns are first the stated ones of the rows, in their order, then all other stated names.
    """
    counts = Counter(found)
    rows = tuple(sorted({hidden for hidden, _ in counts}))
    stated = {column for _, column in counts}
    columns = [row for row in rows if row in stated] + sorted(stated - set(rows))
    return Confusion(rows, tuple(columns), dict(counts))
