"""The registry of effects: every module of this folder is one effect, its `EFFECT`."""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from typing import Literal

from drivers.errors import ConfigurationError
from drivers.strip.effects.effect import Effect
from drivers.strip.model import Effects, StripModel


@cache
def registry() -> Mapping[str, Effect]:
    """Effects by name, in the order in which they apply: laws, boundary, observation."""
    modules = [name for _, name, _ in pkgutil.iter_modules(__path__) if name != "effect"]
    effects = [importlib.import_module(f"{__name__}.{name}").EFFECT for name in modules]
    return {e.name: e for e in sorted(effects, key=lambda e: (e.stage, e.name))}


def apply_effects(model: StripModel, effects: Effects) -> StripModel:
    """`model` with the named effects, in registry order."""
    for name, effect in registry().items():
        if name in effects:
            model = effect.applied(model, _on_strip(effect, effects[name], model))
    return model


def _on_strip(
    effect: Effect, values: Mapping[str, float], model: StripModel
) -> Mapping[str, float]:
    """The values; a place near the end of the stated strip is at the end of a shorter one."""
    end = model.mechanics.length
    places = {p.name for p in effect.parameters if p.role == "place"}
    beyond = {n for n in places & values.keys() if end < values[n] <= model.stated_length}
    return {**values, **dict.fromkeys(beyond, end)}


def check_effects(effects: Effects, origin: str, of: Literal["strip", "cell"]) -> None:
    """Refuse unknown effects, parameters and values outside their range."""
    for name, values in effects.items():
        known = [e.name for e in registry().values() if e.of == of]
        if name not in known:
            raise ConfigurationError(
                f"{origin}: effects.{name}: unknown effect of the {of}; allowed: {', '.join(known)}"
            )
        registry()[name].check(values, f"{origin}: effects.{name}")
