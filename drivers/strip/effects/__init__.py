"""Registry of effects: `EFFECT` from every module in this folder, and effects from plug-ins."""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Literal

from drivers.errors import ConfigurationError, suggestion
from drivers.plugins import plugins
from drivers.strip.effects.effect import Effect
from drivers.strip.model import Effects, StripModel


@cache
def registry() -> Mapping[str, Effect]:
    """All effects by name, in the order in which they apply: by stage, then by name."""
    modules = [name for _, name, _ in pkgutil.iter_modules(__path__) if name != "effect"]
    own = [importlib.import_module(f"{__name__}.{name}").EFFECT for name in modules]
    effects = [*own, *plugins("effects", Effect, {effect.name for effect in own}).values()]
    return {e.name: e for e in sorted(effects, key=lambda e: (e.stage, e.name))}


def apply_effects(model: StripModel, effects: Effects) -> StripModel:
    """`model` with all `effects` applied, in registry order."""
    for name, effect in registry().items():
        if name in effects:
            model = effect.apply_to(model, _fit_to_strip(effect, effects[name], model))
    return model


def _checkout_hint(name: str) -> str:
    """Error hint where the working folder has a file of effect `name` that is not installed."""
    path = Path("drivers", "strip", "effects", f"{name}.py")
    if not path.is_file():
        return ""
    return f"; {path} is not a part of the installed package: run `pip install -e .` here"


def _fit_to_strip(
    effect: Effect, values: Mapping[str, float], model: StripModel
) -> Mapping[str, float]:
    """`values` on this strip, with places beyond a shorter strip's true end moved to that end."""
    end = model.mechanics.length
    places = {p.name for p in effect.parameters if p.role == "place"}
    given = places & values.keys()
    beyond = {name for name in given if end < values[name] <= model.stated_length}
    return {**values, **dict.fromkeys(beyond, end)}


def check_effects(effects: Effects, origin: str, of: Literal["strip", "cell"]) -> None:
    """Raise ConfigurationError for unknown effects or parameters and for values out of range."""
    for name, values in effects.items():
        known = [e.name for e in registry().values() if e.of == of]
        if name not in known:
            raise ConfigurationError(
                f"{origin}: effects.{name}: unknown effect of the {of}{suggestion(name, known)}; "
                f"allowed: {', '.join(known)}{_checkout_hint(name)}"
            )
        registry()[name].check(values, f"{origin}: effects.{name}")
