"""Construction of a strip's physical model from its file, and validation of such files."""

from collections.abc import Collection
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
    """Build the model of `strip` in a cell, with the effects of both applied in registry order.

    `index` is the number of runs that this specimen has already been through.
    """
    effects = {**strip.effects, **(cell_effects or {})}
    # Text, because the inputs hold dicts, which have no hash; and repr keeps -0.0 and 0.0 apart.
    key = f"{strip!r} {sorted(effects.items())!r} {index}"
    return _build_model(_Inputs(key, strip, effects, index))


@dataclass(frozen=True, slots=True)
class _Inputs:
    """Inputs of a strip model, compared and hashed by `key` alone."""

    key: str
    strip: StripFile = field(compare=False)
    effects: Effects = field(compare=False)
    index: int = field(compare=False)


@lru_cache(maxsize=16)
def _build_model(inputs: _Inputs) -> StripModel:
    """Build a strip model, or take it from the cache: models are read-only and shared."""
    strip = inputs.strip
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
    bare = StripModel(mechanics=mechanics, stated_length=strip.length, index=inputs.index)
    effective = apply_effects(bare, inputs.effects)
    return with_law(effective, strip.law) if strip.law else effective


def load_strip(path: Path) -> StripFile:
    """Load the strip file at `path`; raises ConfigurationError where it or an effect is wrong."""
    return _load(path, of_cell=frozenset())


def load_plant(path: Path) -> StripFile:
    """Load the plant file at `path`: a strip file that may also hold effects of the cell.

    Raises ConfigurationError where it or its effects are wrong.
    """
    return _load(path, of_cell={name for name, e in registry().items() if e.of == "cell"})


def _load(path: Path, of_cell: Collection[str]) -> StripFile:
    """Load the strip file at `path`, whose effects are of strips or among those `of_cell`."""
    strip = load(path, StripFile)
    for name, values in strip.effects.items():
        check_effects({name: values}, str(path), "cell" if name in of_cell else "strip")
    check_law(strip.law, origin=str(path))
    check_described(strip, origin=str(path))
    return strip


def check_described(strip: StripFile, origin: str) -> None:
    """Raise ConfigurationError for a strip that no engine simulates, or effects that do not fit."""
    check_valid(strip, origin)
    try:
        describe(strip)
    except ConfigurationError as error:
        raise ConfigurationError(f"{origin}: {error}") from None
