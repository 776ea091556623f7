"""Format of numbers in tables."""

from cell.report.words import NO_VALUE, millimetres


def numeral(value: float, *, signed: bool = False) -> str:
    """A length [m] as millimetres without a unit."""
    return millimetres(value, signed).removesuffix(" mm")


def newtons(value: float) -> str:
    """A force [N] with two decimals and without a unit."""
    return f"{value:.2f}" if abs(value) < float("inf") else NO_VALUE
