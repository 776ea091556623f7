"""Text for operators: lengths, times, counts, events and outcomes of runs."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeGuard

from drivers.base.readers import read_yaml

MINUS = "\N{MINUS SIGN}"
NO_VALUE = "\N{EM DASH}"

EVENT_TITLES, OUTCOMES, PARAMETERS, SIGNAL_UNITS, LENGTH_NAMES, SIGNED = read_yaml(
    Path(__file__).with_suffix(".yaml")
).values()
LONGEST_TEXT = 160  # characters of a value


def plain(name: str) -> str:
    """A `name` of records in words, with spaces instead of underscores."""
    return name.replace("_", " ")


def plural(count: int, noun: str) -> str:
    """Text of `count` things called `noun`, in the plural unless `count` is 1."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _is_known(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value)


def millimetres(value: float | None, signed: bool = False) -> str:
    """Text of a length [m] in mm with one decimal; of a size, with two where one shows
    zero.
    """
    if not _is_known(value):
        return NO_VALUE
    decimals = 2 if 5e-6 <= value < 5e-5 and not signed else 1
    value = round(value, 3 + decimals) + 0.0  # never minus nothing
    text = f"{1e3 * value:{'+' if signed else ''}.{decimals}f}"
    return f"{text.replace('-', MINUS)} mm"


def seconds(value: float | None, decimals: int = 2) -> str:
    """Text of a time `value` [s] in seconds, with `decimals`."""
    if not _is_known(value):
        return NO_VALUE
    return f"{value:.{decimals}f} s".replace("-", MINUS)


def milliseconds(value: float | None) -> str:
    """Text of a time `value` [s] in milliseconds."""
    if not _is_known(value):
        return NO_VALUE
    # never minus nothing
    return f"{round(1e3 * value, 1) + 0.0:.1f} ms".replace("-", MINUS)


def event_title(kind: str) -> str:
    """Text of an event's `kind`, with spaces instead of underscores."""
    return plain(EVENT_TITLES.get(kind, kind))


def outcome_title(outcome: str) -> str:
    """Text of an `outcome` as the start of a sentence; a fault is called by its
    name.
    """
    return str(OUTCOMES.get(outcome, f"Stopped by a fault: {plain(outcome)}"))


def log_line(kind: str, facts: Mapping[str, Any]) -> str:
    """One line of a log on an event of this `kind` with these `facts`."""
    said = event_sentence(facts)
    return (
        said if kind == "state" else ": ".join(filter(None, [event_title(kind), said]))
    )


def event_sentence(facts: Mapping[str, Any]) -> str:
    """Text of an event's `facts` in one line."""
    if set(facts) == {"state", "event"}:
        return f"{facts['state']}, after {plain(str(facts['event']))}"
    return ", ".join(
        f"{plain(name)} {value_text(name, value)}" for name, value in facts.items()
    )


def value_text(name: str, value: Any) -> str:
    """Text of the fact `name`: lengths in mm, other numbers with their unit."""
    if isinstance(value, dict):
        return " ".join(
            f"{plain(key)} {value_text(key, v)}" for key, v in value.items()
        )
    if not isinstance(value, int | float) or isinstance(value, bool):
        text = str(value)
        return text if len(text) <= LONGEST_TEXT else f"{text[: LONGEST_TEXT - 3]}..."
    if name in LENGTH_NAMES:
        return millimetres(value, signed=name in SIGNED)
    unit = SIGNAL_UNITS.get(name, "")
    if unit == "s":
        return milliseconds(value)
    digits = ".3g" if isinstance(value, float) else ""
    return f"{value:{digits}} {unit}".strip()
