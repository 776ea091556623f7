"""Lengths as an operator writes them: `3.5mm`, `0.0035m`, or metres without a unit."""

import math
import re

from drivers.errors import ConfigurationError

UNITS = {"": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3}


def metres(option: str, text: str, most: float) -> float:
    """The length [m] that `text` states, of at most `most` [m] to either side.

    Raises ConfigurationError naming `option` for anything else.
    """
    found = re.fullmatch(r"\s*([-+]?[\d.]+(?:e-?\d+)?)\s*(m|cm|mm)?\s*", text)
    try:
        value = float(found[1]) * UNITS[found[2] or ""] if found else math.nan
    except ValueError:
        value = math.nan
    if abs(value) <= most:
        return value
    raise ConfigurationError(
        f"{option}: {text!r} is no length of at most {1e3 * most:g} mm; write one as 3.5mm"
    )
