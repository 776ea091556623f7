"""Ranges of strip properties in which the rod and chain engines were validated.

Measured by `python -m tests.lab study validity`: folds of denim with one value changed,
against the same engine with half its step in space. Inside the bounds that changes the
displacement by at most 3 mm, and rod and chain agree to 3 mm. Width and areal density were
measured too, from 2 mm to 1 m and from 0.001 to 50 kg/m^2: without air they change nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from drivers.errors import ConfigurationError
from drivers.strip.file import StripFile


@dataclass(frozen=True, slots=True)
class Bound:
    """Validated range of one strip property in one `engine`: `value` from `low` to `high`.

    Below `refused` the engine gives no result at all. `why` is what happens outside.
    """

    key: str
    engine: str
    value: Callable[[StripFile], float]
    low: float
    high: float
    why: str
    refused: float = -inf


def _softness(strip: StripFile) -> float:
    return strip.bending_length / strip.length


BOUNDS = (
    Bound(
        key="bending_length over length",
        engine="chain (the twin)",
        value=_softness,
        low=0.013,
        high=0.35,
        refused=0.0095,
        why="its 80 links are too coarse for so soft a strip: d is off by 7 to 13 mm below 0.011, "
        "and below 0.007 the simulation diverges",
    ),
    Bound(
        key="bending_length over length",
        engine="rod (the model)",
        value=_softness,
        low=0.009,
        high=0.35,
        why="its segments are too coarse for so soft a strip: d is off by 20 mm at 0.0085",
    ),
    Bound(
        key="retardation_time",
        engine="chain (the twin)",
        value=lambda strip: strip.retardation_time,
        low=0.0,
        high=3.0,
        why="so sluggish a strip is still bending when the fold ends: rod and chain are 4 mm apart "
        "at 10 s",
    ),
    *(
        Bound(
            key="thickness [m]",
            engine=engine,
            value=lambda strip: strip.thickness,
            low=0.0,
            high=0.004,
            why="layers touch late or never at its midline: from 8 mm on no fold ends in a touch",
        )
        for engine in ("chain (the twin)", "rod (the model)")
    ),
)


def doubts(strip: StripFile) -> tuple[str, ...]:
    """Warnings about properties of `strip` outside an engine's validated range, a sentence each."""
    return tuple(
        f"{strip.name}: {_location(bound, strip)}, the {bound.engine} holds from {bound.low:g} to "
        f"{bound.high:g}: {bound.why}; expect errors of the simulation"
        for bound in BOUNDS
        if not bound.low <= bound.value(strip) <= bound.high
    )


def check_valid(strip: StripFile, origin: str) -> None:
    """Raise ConfigurationError for a strip that an engine cannot simulate at all."""
    for bound in BOUNDS:
        if bound.value(strip) < bound.refused:
            raise ConfigurationError(
                f"{origin}: {_location(bound, strip)}, the {bound.engine} is refused below "
                f"{bound.refused:g}: {bound.why}; take a shorter strip or a stiffer one"
            )


def _location(bound: Bound, strip: StripFile) -> str:
    return f"{bound.key}: is {bound.value(strip):.3g}"
