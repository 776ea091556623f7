"""Text of numbers and outcomes for a technician."""

import math

MINUS = "\N{MINUS SIGN}"
NO_VALUE = "\N{EM DASH}"

OUTCOMES = {
    "layer_touch": "The layers touched",
    "path_done": "The path ended before the layers touched",
    "interrupted": "Stopped by the operator",
    "edges_not_seen": "Not folded: no fold is seen where it was laid",
    "edges_apart": "Not folded: the edges do not lie where they were laid",
    "unlike_model": "Not folded as predicted: the strip does not behave like the model",
}


def plural(count: int, noun: str) -> str:
    """`count` and the `noun`, in the plural but for one."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def millimetres(value: float | None, signed: bool = False) -> str:
    """A length [m] as millimetres with one decimal, with two where one would show zero."""
    if value is None or not math.isfinite(value):
        return NO_VALUE
    decimals = 2 if 0 < abs(value) < 5e-5 else 1
    text = f"{1e3 * value:{'+' if signed else ''}.{decimals}f}"
    return f"{text.replace('-', MINUS)} mm"


def seconds(value: float | None, decimals: int = 2) -> str:
    """A time [s]."""
    if value is None or not math.isfinite(value):
        return NO_VALUE
    return f"{value:.{decimals}f}".replace("-", MINUS) + " s"


def milliseconds(value: float | None) -> str:
    """A time [s] as milliseconds."""
    if value is None or not math.isfinite(value):
        return NO_VALUE
    return f"{1e3 * value:.3g} ms".replace("-", MINUS)


def outcome_title(outcome: str) -> str:
    """An outcome as the start of a sentence; a fault keeps its own name."""
    return OUTCOMES.get(outcome, f"Stopped by a fault: {outcome.replace('_', ' ')}")


def side(displacement: float) -> str:
    """What the sign of d = l1 - l2 [m] means of the upper layer."""
    return "longer" if displacement > 0 else "shorter"
