"""Lengths as an operator writes them: `3.5mm`, `0.0035m`, or metres without a unit."""

import math
import re

from drivers.errors import ConfigurationError

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


def length(text: str, bare: str = "m") -> float:
    """The length [m] that `text` states, in `bare` where it names no unit; otherwise NaN."""
    found = re.fullmatch(r"\s*([-+]?[\d.]+(?:e-?\d+)?)\s*(m|cm|mm)?\s*", text)
    try:
        return float(found[1]) * UNITS[found[2] or bare] if found else math.nan
    except ValueError:
        return math.nan


def metres(option: str, text: str, most: float) -> float:
    """The length [m] that `text` states, of at most `most` [m] to either side.

    Raises ConfigurationError naming `option` for anything else.
    """
    value = length(text)
    if abs(value) <= most:
        return value
    raise ConfigurationError(
        f"{option}: {text!r} is no length of at most {1e3 * most:g} mm; write one as 3.5mm"
    )
