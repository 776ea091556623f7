"""The physical description of a strip from its file, and validation of files that need it."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from drivers.errors import ConfigurationError
from drivers.settings import load
from drivers.strip.effects import apply_effects, check_effects, registry
from drivers.strip.file import StripFile
from drivers.strip.law import check_law, with_law
from drivers.strip.model import CELLS, Effects, Mechanics, StripModel
from drivers.strip.validity import check_valid
from drivers.types import frozen


def describe(strip: StripFile, cell_effects: Effects | None = None, index: int = 0) -> StripModel:
    """The description of `strip` in a cell, with the effects of both applied in registry order.

    `index` is the number of runs that this specimen has already been through.
    """
    effects = {**strip.effects, **(cell_effects or {})}
    return _describe_cached(
        _CacheKey(f"{strip!r} {sorted(effects.items())!r} {index}", strip, effects, index)
    )


@dataclass(frozen=True, slots=True)
class _CacheKey:
    """Cache key of a description: equal where all inputs are equal."""

    key: str
    strip: StripFile = field(compare=False)
    effects: Effects = field(compare=False)
    index: int = field(compare=False)


@lru_cache(maxsize=16)
def _describe_cached(asked: _CacheKey) -> StripModel:
    """A strip's description from the cache; descriptions are read-only and shared."""
    strip = asked.strip
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
    bare = StripModel(mechanics=mechanics, stated_length=strip.length, index=asked.index)
    whole = apply_effects(bare, asked.effects)
    return with_law(whole, strip.law) if strip.law else whole


def load_strip(path: Path) -> StripFile:
    """The strip file at `path`; raises ConfigurationError where it or its effects are wrong."""
    strip = load(path, StripFile)
    check_effects(strip.effects, origin=str(path), of="strip")
    check_law(strip.law, origin=str(path))
    check_described(strip, origin=str(path))
    return strip


def load_plant(path: Path) -> StripFile:
    """The plant file at `path`: a strip file that may also hold effects of the rig.

    Raises ConfigurationError where it or its effects are wrong.
    """
    plant = load(path, StripFile)
    rig = {n: v for n, v in plant.effects.items() if n in registry() and registry()[n].of == "cell"}
    own = {n: v for n, v in plant.effects.items() if n not in rig}
    check_effects(own, origin=str(path), of="strip")
    check_effects(rig, origin=str(path), of="cell")
    check_law(plant.law, origin=str(path))
    check_described(plant, origin=str(path))
    return plant


def check_described(strip: StripFile, origin: str) -> None:
    """Raise ConfigurationError for a strip that no engine simulates, or effects that do not fit."""
    check_valid(strip, origin)
    try:
        describe(strip)
    except ConfigurationError as error:
        raise ConfigurationError(f"{origin}: {error}") from None
