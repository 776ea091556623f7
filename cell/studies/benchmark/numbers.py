"""Format of numbers in tables."""

import math

from cell.report.words import MINUS, NO_VALUE


def numeral(value: float, *, signed: bool = False) -> str:
    """A length [m] as millimetres with one decimal and without a unit."""
    if not math.isfinite(value):
        return NO_VALUE
    return f"{1e3 * value:{'+' if signed else ''}.1f}".replace("-", MINUS)


def newtons(value: float) -> str:
    """A force [N] with two decimals and without a unit."""
    return f"{value:.2f}" if math.isfinite(value) else NO_VALUE
