"""Strips that have no file: their length and perhaps their thickness are known, and the
rest is assumed.
"""

from typing import Any

from cell.base.config.length import metres
from drivers.base.settings import parse
from drivers.strip.file import StripFile

UNKNOWN_NAME = "unknown"
# before its length [m], and its thickness [m] if known, where a strip is named
MARK = UNKNOWN_NAME + ":"
ASSUMED_WIDTH, ASSUMED_DENSITY = 0.05, 0.3  # m, kg/m^2
# m, s: range of the strips of Petrik and Kyrki, IROS 2019
BENDING_LENGTH, RETARDATION_TIME = (0.0135, 0.0333), (0.004, 1.0)
THICKNESS_RANGE = (0.0002, 0.003)  # m, of shirting and of felt
ASSUMED_KEYS = ("width", "areal_density", "bending_length", "retardation_time")
CALIPERS = {"key": "thickness", "source": "measured", "note": "stated by the operator"}


def unmeasured_name(length: float, thickness: float | None) -> str:
    """Name that stands for a strip without a file, of `length` [m] and, unless None,
    `thickness` [m].
    """
    return f"{MARK}{length:g}" + ("" if thickness is None else f":{thickness:g}")


def unmeasured_strip(known: str) -> StripFile:
    """Strip of which only the length, and perhaps the thickness, in metres are `known`:
    "0.6" or "0.6:0.001".

    The rest is assumed, in the middle of its range. Raises ConfigurationError for other
    text.
    """
    length, _, thickness = known.partition(":")
    (c_low, c_high), (t_low, t_high) = BENDING_LENGTH, RETARDATION_TIME
    spread = {"bending_length": BENDING_LENGTH, "retardation_time": RETARDATION_TIME}
    content: dict[str, Any] = {
        "name": UNKNOWN_NAME,
        "length": metres("length", length),
        "width": ASSUMED_WIDTH,
        "areal_density": ASSUMED_DENSITY,
        "bending_length": (c_low * c_high) ** 0.5,
        "retardation_time": (t_low * t_high) ** 0.5,
        "spread": spread,
        "provenance": [{"key": key, "source": "assumed"} for key in ASSUMED_KEYS],
    }
    if thickness:
        content["thickness"] = metres("thickness", thickness)
        content["provenance"].append(CALIPERS)
    else:
        spread["thickness"] = THICKNESS_RANGE
        content["provenance"].append({"key": "thickness", "source": "assumed"})

    return parse(content, StripFile, "length, thickness")
