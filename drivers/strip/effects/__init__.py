"""Registry of a strip's and its cell's effects: built-in ones of this folder, and
plug-ins.
"""

from collections.abc import Collection, Mapping
from functools import cache

from drivers.base.errors import ConfigurationError, suggestion
from drivers.base.plugins import plugins
from drivers.strip.effects import bending, mass, rig
from drivers.strip.effects.effect import Effect
from drivers.strip.model import Effects, StripModel

FAMILIES = (bending, mass, rig)


@cache
def registry() -> Mapping[str, Effect]:
    """All known effects by name, in the order in which they apply: by stage, then by
    name.
    """
    built_in = [
        e for family in FAMILIES for e in vars(family).values() if isinstance(e, Effect)
    ]
    effects = [
        *built_in,
        *plugins("effects", Effect, {effect.name for effect in built_in}).values(),
    ]
    return {e.name: e for e in sorted(effects, key=lambda e: (e.stage, e.name))}


def apply_effects(model: StripModel, effects: Effects) -> StripModel:
    """Copy of `model` with all `effects` applied, in registry order."""
    for name, effect in registry().items():
        if name in effects:
            model = effect.apply_to(model, _fit_to_strip(effect, effects[name], model))
    return model


def _fit_to_strip(
    effect: Effect, values: Mapping[str, float], model: StripModel
) -> Mapping[str, float]:
    """Copy of the effect's parameter `values` whose positions beyond the end of a strip
    that is shorter than stated are moved to that end.
    """
    end = model.mechanics.length
    places = [
        p.name for p in effect.parameters if p.role == "place" and p.name in values
    ]
    return {
        **values,
        **{p: end for p in places if end < values[p] <= model.stated_length},
    }


def check_effects(effects: Effects, origin: str, of: Collection[str]) -> None:
    """Raise ConfigurationError for unknown effects or parameters, or values out of
    range.

    Known are the effects `of` strips, of cells or of both; `origin` names the file in
    the error.
    """
    known = [e.name for e in registry().values() if e.of in of]
    kinds = " or ".join(of)
    for name, values in effects.items():
        if name not in known:
            raise ConfigurationError(
                f"{origin}: effects.{name}: unknown effect of the {kinds}"
                f"{suggestion(name, known)}; allowed: {', '.join(known)}"
            )
        registry()[name].check(values, f"{origin}: effects.{name}")
