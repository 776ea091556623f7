"""Refitted values beyond what the file states: the runs are of another strip, or it is wrong."""

from collections.abc import Mapping, Sequence

import numpy as np

from cell.gap.subject.subject import Parameter
from cell.gap.verdict.schema import Deviation, Interval

TOLERATED = 2.0  # standard deviations of what was known before, without a stated range: 95 %


def deviations(base: Sequence[Parameter], found: Mapping[str, Interval]) -> list[Deviation]:
    """The values `found` whose whole 95 % interval lies outside what the file tolerates."""
    rows = []
    for p in base:
        value = found.get(p.name)
        if value is None:
            continue
        low, high = _tolerated(p)
        above = value.low is not None and value.low > high
        below = value.high is not None and value.high < low
        if above or below:
            rows.append(
                Deviation(
                    parameter=p.name,
                    stated=p.shown(p.start),
                    tolerated=(low, high if np.isfinite(high) else None),
                    unit=p.unit,
                    **value.model_dump(include={"value", "low", "high"}),
                )
            )
    return rows


def _tolerated(p: Parameter) -> tuple[float, float]:
    """The range that the file allows, as files state the value."""
    if p.tolerated is not None:
        return p.tolerated
    reach = TOLERATED * p.spread
    ends = p.shown(max(p.start - reach, p.low)), p.shown(p.start + reach)
    return min(ends), max(ends)
