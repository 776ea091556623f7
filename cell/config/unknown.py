"""A fabric without a file: what is assumed of it before the fold."""

from drivers.errors import ConfigurationError
from drivers.settings import parse
from drivers.strip.file import StripFile

NAME = "unknown"
MARK = NAME + ":"  # before its length [m], where a strip is named
WIDTH, DENSITY = 0.05, 0.3  # m, kg/m^2
BENDING_LENGTH, RETARDATION_TIME = (0.0135, 0.0333), (0.004, 1.0)  # m, s: the paper's range
THICKNESS = (0.0002, 0.003)  # m, of shirting and of felt
ASSUMED = ("width", "areal_density", "bending_length", "retardation_time", "thickness")


def unknown_strip(length: str) -> StripFile:
    """The strip of `length` [m] that nobody measured: the middle of the paper's range.

    Raises ConfigurationError for what is no length.
    """
    try:
        metres = float(length)
    except ValueError:
        raise ConfigurationError(
            f"--length: {length!r} is no number; give the strip's length in metres, as 0.6"
        ) from None
    (c_low, c_high), (t_low, t_high) = BENDING_LENGTH, RETARDATION_TIME
    content = {
        "name": NAME,
        "length": metres,
        "width": WIDTH,
        "areal_density": DENSITY,
        "bending_length": (c_low * c_high) ** 0.5,
        "retardation_time": (t_low * t_high) ** 0.5,
        "spread": {
            "bending_length": list(BENDING_LENGTH),
            "retardation_time": list(RETARDATION_TIME),
            "thickness": list(THICKNESS),
        },
        "provenance": [{"key": key, "source": "assumed"} for key in ASSUMED],
    }
    return parse(content, StripFile, "--length")
