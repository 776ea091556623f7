"""What is shown of a run: one tick, or one line of words."""

from dataclasses import dataclass
from math import nan

from calibration.perception.sight import Sight
from drivers.types import Array, Image


@dataclass(frozen=True, slots=True)
class Moment:
    """One tick: `clock` [s], `t` since the lift began [s] (NaN before), gripper `pose` (3,);
    `sight` and `image` only when they are new.
    """

    clock: float
    t: float
    tick: int
    state: str
    pose: Array
    sight: Sight | None = None
    image: Image | None = None


@dataclass(frozen=True, slots=True)
class Words:
    """A line for the log at `clock` [s] and `t` [s]; `alarm` marks what stopped the run."""

    clock: float
    text: str
    alarm: bool
    t: float = nan


def told(kind: str, facts: dict[str, object]) -> str:
    """An event as a line of words."""
    if set(facts) == {"state", "event"}:
        return f"{facts['state']}, after {facts['event']}"
    text = ", ".join([kind, *(f"{key} {value}" for key, value in facts.items())])
    return text if len(text) <= 300 else f"{text[:297]}..."
