"""Format of numbers in tables."""

from cell.report.words import NO_VALUE, millimetres


def numeral(value: float, *, signed: bool = False) -> str:
    """Format a length [m] as millimetres without a unit."""
    return millimetres(value, signed).removesuffix(" mm")


def newtons(value: float) -> str:
    """Format a force [N] with two decimals and without a unit."""
    return f"{value:.2f}" if abs(value) < float("inf") else NO_VALUE
