"""Numbers and units as a person reads them."""

from cell.gap.verdict.schema import Measured

POWERS = {"^2": "²", "^3": "³", "^4": "⁴"}


def unit(text: str) -> str:
    """A unit with raised powers; a pure number has none."""
    for plain, raised in POWERS.items():
        text = text.replace(plain, raised)
    return "" if text == "1" else text.replace(" ", "\N{NO-BREAK SPACE}")


def number(value: float, digits: int = 3) -> str:
    """A number in few digits, a power of ten written out."""
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, power = text.split("e")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}·10{raised}"


def probability(p: float) -> str:
    """A probability; below one in a billion its size says nothing."""
    return "< 10⁻⁹" if p < 1e-9 else number(p, 2)


def quantity(value: float, of: str) -> str:
    """A number with its unit."""
    return f"{number(value)}\N{NO-BREAK SPACE}{unit(of)}".rstrip("\N{NO-BREAK SPACE}")


def interval(value: Measured) -> str:
    """An estimate with its interval and unit."""
    if value.low is None or value.high is None:
        return quantity(value.value, value.unit)
    ends = f"[{number(value.low)}, {number(value.high)}]"
    return f"{number(value.value)} {ends} {unit(value.unit)}".rstrip()
