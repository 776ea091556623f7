"""Construction of a strip's physical model from a strip file, and validation of strip
files.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from drivers.base.errors import ConfigurationError
from drivers.base.settings import load
from drivers.base.types import frozen
from drivers.strip.effects import apply_effects, check_effects
from drivers.strip.file import StripFile
from drivers.strip.law import check_law, with_law
from drivers.strip.model import CELLS, Effects, Mechanics, StripModel


def describe(
    strip: StripFile, cell_effects: Effects | None = None, index: int = 0
) -> StripModel:
    """Build the physical model of `strip` with the effects in its file, which
    `cell_effects` override.

    `index` is the number of runs that this specimen has already been through.
    """
    rigidity = np.full(CELLS, strip.rigidity)
    mechanics = Mechanics(
        length=strip.length,
        width=strip.width,
        thickness=strip.thickness,
        rigidity=frozen(rigidity),
        viscosity=frozen(rigidity * strip.retardation_time),
        rest_curvature=frozen(np.zeros(CELLS)),
        linear_density=frozen(np.full(CELLS, strip.linear_density)),
    )
    bare = StripModel(mechanics=mechanics, stated_length=strip.length, index=index)
    effects = {**strip.effects, **(cell_effects or {})}
    return with_law(apply_effects(bare, effects), strip.law)


def load_plant(path: Path) -> StripFile:
    """Load the file at `path` of a strip to simulate, which may also state effects of
    the cell.
    """
    return load_strip(path, ("strip", "cell"))


def load_strip(path: Path, of: Collection[str] = ("strip",)) -> StripFile:
    """Load the strip file at `path`, whose effects may be of the kinds in `of`
    ("strip", "cell").

    Raises ConfigurationError for a bad file, for effects or a law out of range or
    beside the strip, and for a strip that one engine refuses: the twin's chain and the
    rod must both simulate it.
    """
    strip = load(path, StripFile)
    check_effects(strip.effects, str(path), of)
    check_law(strip.law, origin=str(path))

    for bound in BOUNDS:
        if bound.value(strip) < bound.refused:
            raise ConfigurationError(
                f"{path}: {bound.key}: is {bound.value(strip):.3g}, the {bound.engine}"
                f" is refused below {bound.refused:g}: {bound.why}; take a shorter"
                " strip or a stiffer one"
            )

    try:
        describe(strip)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    return strip


@dataclass(frozen=True, slots=True)
class Bound:
    """Range from `low` to `high` of a strip's property `value` in which a simulation
    `engine` is validated.

    Below `refused` the engine gives no result at all; `why` is what happens outside.
    Measured on folds of denim with one value changed, against the same engine with
    half its step in space. Within the range that
    changes the displacement by at most 3 mm, and rod and chain agree to 3 mm. Width and
    areal density were measured too, from 2 mm to 1 m and from 0.001 to 50 kg/m^2:
    without air they change nothing.
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
        why=(
            "its 80 links are too coarse for so soft a strip: d is off by 7 to 13 mm"
            " below 0.011, and below 0.007 the simulation diverges"
        ),
    ),
    Bound(
        key="bending_length over length",
        engine="rod (the model)",
        value=_softness,
        low=0.009,
        high=0.35,
        why=(
            "its segments are too coarse for so soft a strip: d is off by 20 mm at"
            " 0.0085"
        ),
    ),
    Bound(
        key="retardation_time",
        engine="chain (the twin)",
        value=lambda strip: strip.retardation_time,
        low=0.0,
        high=3.0,
        why=(
            "so sluggish a strip is still bending when the fold ends: rod and chain are"
            " 4 mm apart at 10 s"
        ),
    ),
    *(
        Bound(
            key="thickness [m]",
            engine=engine,
            value=lambda strip: strip.thickness,
            low=0.0,
            high=0.004,
            why=(
                "layers touch late or never at its midline: from 8 mm on no fold ends"
                " in a touch"
            ),
        )
        for engine in ("chain (the twin)", "rod (the model)")
    ),
)


def doubts(strip: StripFile) -> tuple[str, ...]:
    """Warnings, a sentence each, on properties of `strip` outside an engine's validated
    range.
    """
    return tuple(
        f"{strip.name}: {bound.key}: is {bound.value(strip):.3g}, the {bound.engine}"
        f" holds from {bound.low:g} to {bound.high:g}: {bound.why}; expect errors of"
        " the simulation"
        for bound in BOUNDS
        if not bound.low <= bound.value(strip) <= bound.high
    )
