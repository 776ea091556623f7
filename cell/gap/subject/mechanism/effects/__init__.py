"""Library of effects of mechanisms: each module of this folder defines one, its `EFFECT`."""

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache

from cell.gap.subject.mechanism.effect import Effect
from cell.gap.subject.mechanism.passive import Torques
from cell.gap.subject.mechanism.terms import TERMS


@cache
def registry() -> Mapping[str, Effect]:
    """The library's effects of mechanisms by name."""
    modules = sorted(name for _, name, _ in pkgutil.iter_modules(__path__))
    effects = [importlib.import_module(f"{__name__}.{name}").EFFECT for name in modules]
    return {e.name: e for e in effects}


@cache
def torques() -> Torques:
    """Torque laws of all effects and terms, compiled together."""
    every = [*registry().values(), *TERMS]
    return Torques([(e.name, e.law, e.keys) for e in every if e.law is not None])
