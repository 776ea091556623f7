"""Text for operators: lengths, times, counts, events and outcomes of runs."""

import math

MINUS = "\N{MINUS SIGN}"
NO_VALUE = "\N{EM DASH}"

EVENT_TITLES = {  # where a kind of event needs more than its name in records
    "foretold": "predicted",
    "touch_seen": "touch noticed",
    "released": "released, as the arm stands",
    "edges_seen": "edges, as the camera sees them",
}
OUTCOMES = {
    "layer_touch": "The layers touched",
    "path_done": "The path ended before the layers touched",
    "interrupted": "Stopped by the operator",
    "edges_not_seen": "Not folded: no fold is seen where it was laid",
    "edges_apart": "Not folded: the edges do not lie where they were laid",
    "grip_apart": "Folded, but camera and arm disagree on where the held end is",
    "displacement_apart": "Folded, but far off the prediction",
    "unlike_model": "Folded, but the strip does not behave like the model",
}


def plural(count: int, noun: str) -> str:
    """Text of `count` things called `noun`, in the plural unless `count` is 1."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def millimetres(value: float | None, signed: bool = False) -> str:
    """Text of a length [m] in mm with one decimal; with two where one decimal shows
    zero.
    """
    if value is None or not math.isfinite(value):
        return NO_VALUE
    decimals = 2 if 5e-6 <= abs(value) < 5e-5 else 1
    value = 0.0 if abs(value) < 5e-6 else value
    text = f"{1e3 * value:{'+' if signed else ''}.{decimals}f}"
    return f"{text.replace('-', MINUS)} mm"


def seconds(value: float | None, decimals: int = 2) -> str:
    """Text of a time `value` [s] in seconds, with `decimals`."""
    if value is None or not math.isfinite(value):
        return NO_VALUE
    return f"{value:.{decimals}f}".replace("-", MINUS) + " s"


def milliseconds(value: float | None) -> str:
    """Text of a time `value` [s] in milliseconds."""
    if value is None or not math.isfinite(value):
        return NO_VALUE
    # never minus nothing
    return f"{round(1e3 * value, 1) + 0.0:.1f} ms".replace("-", MINUS)


def event_title(kind: str) -> str:
    """Text of an event's `kind`, with spaces instead of underscores."""
    return EVENT_TITLES.get(kind, kind).replace("_", " ")


def outcome_title(outcome: str) -> str:
    """Text of an `outcome` as the start of a sentence; a fault is called by its
    name.
    """
    return OUTCOMES.get(outcome, f"Stopped by a fault: {outcome.replace('_', ' ')}")
