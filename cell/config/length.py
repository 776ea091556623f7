"""Lengths as operators write them, `3.5mm` or `0.0035m`, and strips known by their length alone."""

import re
from math import inf, nan

from drivers.errors import ConfigurationError

LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


def length(text: str, bare: str = "m") -> float:
    """Length [m] that `text` states, in the unit `bare` where it names none; NaN for other text."""
    found = re.fullmatch(r"\s*([-+]?[\d.]+(?:e-?\d+)?)\s*(m|cm|mm)?\s*", text)
    try:
        return float(found[1]) * LENGTH_UNITS[found[2] or bare] if found else nan
    except ValueError:
        return nan


def metres(
    option: str, text: str, largest: float = inf, *, bare: str = "m", least: float = -inf
) -> float:
    """The length [m] that `text` states: `600mm`, `60cm`, `0.6m`, or a number in `bare`.

    Raises ConfigurationError naming `option` for other text, and for a length below `least` [m] or
    of more than `largest` [m] to either side.
    """
    value = length(text, bare)
    if value >= least and abs(value) <= largest:
        return value
    bounds = "" if least == -inf else f" of {1e3 * least:g} mm or more"
    bounds += "" if largest == inf else f" of at most {1e3 * largest:g} mm"
    raise ConfigurationError(
        f"{option}: {text!r} is no length{bounds}; write one as 3.5mm, 600mm or 0.6m"
    )
