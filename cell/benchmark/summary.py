"""Summary of a benchmark: one row for each policy."""

from dataclasses import dataclass

import numpy as np

from cell.benchmark.numbers import numeral
from cell.benchmark.results import EffectFolds, ImageFold, RangeFolds, Results
from cell.report.words import NO_VALUE
from drivers.types import Array

NAN = float("nan")


@dataclass(frozen=True, slots=True)
class StripNumbers:
    """Statistics of folds through images: measured d, true |offset| of laid edges [m]; else NaN."""

    folded: int
    of: int
    mean: float
    low: float
    high: float
    worst: float
    worst_strip: str
    misread: float
    offset: float = NAN
    worst_offset: float = NAN

    @classmethod
    def of_folds(cls, folds: tuple[ImageFold, ...], asked: int) -> "StripNumbers":
        """Statistics of `folds`, out of `asked` strips."""
        touched = [(f, f.displacement) for f in folds if f.displacement is not None]
        if not touched:
            return cls(0, asked, NAN, NAN, NAN, NAN, "", NAN)
        d = np.array([value for _, value in touched])
        errors = [abs(v - f.displacement_true) for f, v in touched if f.displacement_true]
        worst = int(np.argmax(np.abs(d)))
        apart = [abs(f.edge_offset_true) for f, _ in touched if f.edge_offset_true is not None]
        return cls(
            folded=len(touched),
            of=asked,
            mean=float(d.mean()),
            low=float(d.min()),
            high=float(d.max()),
            worst=float(abs(d[worst])),
            worst_strip=touched[worst][0].strip,
            misread=max(errors, default=NAN),
            offset=float(np.mean(apart)) if apart else NAN,
            worst_offset=max(apart, default=NAN),
        )


@dataclass(frozen=True, slots=True)
class RangeNumbers:
    """Statistics of |d| over the paper's range [m]; `untouched` folds, mean holding force [N]."""

    mean: float
    quantile_95: float
    worst: float
    untouched: int
    force: float

    @classmethod
    def of_folds(cls, folds: RangeFolds | None) -> "RangeNumbers":
        """Statistics of `folds` over the paper's range."""
        d = np.abs(folds.d[np.isfinite(folds.d)]) if folds is not None else np.zeros(0)
        if folds is None or d.size == 0:
            return cls(NAN, NAN, NAN, 0, NAN)
        missing = int(np.count_nonzero(~np.isfinite(folds.d)))
        spread = float(np.quantile(d, 0.95))
        return cls(float(d.mean()), spread, float(d.max()), missing, float(np.mean(folds.force)))


@dataclass(frozen=True, slots=True)
class Row:
    """Statistics of one policy [m]: over strips, the range in both engines, and repeats."""

    policy: str
    strips: StripNumbers
    rod: RangeNumbers
    chain: RangeNumbers
    repeats: int
    spread: float


def rows(results: Results) -> tuple[Row, ...]:
    """Rows of the summary, one for each policy in the requested order."""
    return tuple(_row(results, policy) for policy in results.asked.policies)


def spread(folds: tuple[ImageFold, ...]) -> float:
    """Largest difference among the displacements of repeated `folds` [m]."""
    d: Array = np.array([f.displacement for f in folds if f.displacement is not None])
    return float(np.ptp(d)) if d.size > 1 else NAN


def misses_text(folds: EffectFolds) -> str:
    """|d| of `folds` as text [mm]: mean, 95 % and worst, and the number without a touch."""
    d = np.abs([value for value in folds.displacement if value is not None])
    if d.size == 0:
        return NO_VALUE
    numbers = (float(np.mean(d)), float(np.quantile(d, 0.95)), float(np.max(d)))
    lost = len(folds.displacement) - d.size
    text = " / ".join(numeral(number) for number in numbers)
    return f"{text}, {lost} without a touch" if lost else text


def _row(results: Results, policy: str) -> Row:
    again = results.repeats(policy)
    return Row(
        policy=policy,
        strips=StripNumbers.of_folds(results.folds(policy), len(results.asked.strips)),
        rod=RangeNumbers.of_folds(results.over_range(policy, "rod")),
        chain=RangeNumbers.of_folds(results.over_range(policy, "chain")),
        repeats=len(again),
        spread=spread(again),
    )
