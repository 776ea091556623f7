"""Formats numbers and units for pages."""

from cell.gap.verdict.schema import Measured

POWERS = {"^2": "²", "^3": "³", "^4": "⁴"}
SMALL_UNITS = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "s": (1e3, "ms"), "kg": (1e3, "g")}
"""Units shown in thousandths, so that a page has one unit for each kind of quantity."""


def in_small_unit(value: float, of: str) -> float:
    """`value`, stated in `of`, converted to the unit that a page shows."""
    return value * SMALL_UNITS.get(of, (1.0, of))[0]


def unit(text: str) -> str:
    """Symbol of a unit as pages show it, powers raised; a pure number has none."""
    text = SMALL_UNITS.get(text, (1.0, text))[1]
    for plain, raised in POWERS.items():
        text = text.replace(plain, raised)
    return "" if text == "1" else text.replace(" ", "\N{NO-BREAK SPACE}")


def number(value: float, digits: int = 3) -> str:
    """Text of a number in few digits, a power of ten written out."""
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, power = text.split("e")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}·10{raised}"


def probability(p: float) -> str:
    """Text of a probability; one below one in a billion is given as that bound."""
    return "< 10⁻⁹" if p < 1e-9 else number(p, 2)


def quantity(value: float, of: str) -> str:
    """Text of a number in the unit `of` with its unit, as a page shows it."""
    return f"{number(in_small_unit(value, of))}\N{NO-BREAK SPACE}{unit(of)}".rstrip(
        "\N{NO-BREAK SPACE}"
    )


def interval(value: Measured) -> str:
    """Text of an estimate with its interval and unit."""
    if value.low is None or value.high is None:
        return quantity(value.value, value.unit)
    low, middle, high = (
        number(in_small_unit(v, value.unit)) for v in (value.low, value.value, value.high)
    )
    return f"{middle} [{low}, {high}] {unit(value.unit)}".rstrip()
