"""Lengths as operators write them, such as `3.5mm` or `0.0035m`."""

import re
from math import inf, nan

from drivers.base.errors import ConfigurationError

LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e-?\d+)?)\s*(m|cm|mm)?\s*")
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


def metres(
    option: str,
    text: str,
    largest: float = inf,
    *,
    bare: str = "m",
    least: float = -inf,
) -> float:
    """Length [m] that `text` states, such as `600mm`, `60cm` or `0.6m`; a number
    without a unit is in the unit `bare`.

    Raises ConfigurationError naming `option` for other text, and for a length below
    `least` [m] or of more than `largest` [m] to either side.
    """
    found = LENGTH.fullmatch(text)
    value = float(found[1]) * LENGTH_UNITS[found[2] or bare] if found else nan
    if value >= least and abs(value) <= largest:
        return value
    bounds = "" if least == -inf else f" of {1e3 * least:g} mm or more"
    bounds += "" if largest == inf else f" of at most {1e3 * largest:g} mm"
    raise ConfigurationError(
        f"{option}: {text!r} is no length{bounds}; write one as 3.5mm, 600mm or 0.6m"
    )
