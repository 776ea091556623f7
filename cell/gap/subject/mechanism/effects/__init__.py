"""Library of effects of mechanisms, a family in each file, and checks of accepted ones.

Further effects come from plug-ins, entry points in the group `folding_cell.mechanism_effects`.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from cell.gap.subject.mechanism.effect import Effect
from cell.gap.subject.mechanism.effects import bodies, compliance, drives, friction, terms
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.mechanism.passive import Torques
from cell.gap.subject.subject import Candidate, NamedValues, Parameter
from drivers.errors import ConfigurationError
from drivers.plugins import plugins
from drivers.types import Array

FAMILIES = (bodies, compliance, drives, friction)


@cache
def registry() -> Mapping[str, Effect]:
    """Effects of mechanisms by name, sorted by it: the library's, and those of plug-ins."""
    known = {e.name: e for family in FAMILIES for e in family.EFFECTS}
    return dict(sorted({**known, **plugins("mechanism_effects", Effect, known)}.items()))


@cache
def torques() -> Torques:
    """Torque laws of all effects and terms, compiled together."""
    every = [*registry().values(), *terms.EFFECTS]
    return Torques([(e.name, e.law, e.keys) for e in every if e.law is not None])


def candidates(
    mechanism: Mechanism, accepted: NamedValues, stated: Collection[str] = ()
) -> tuple[Candidate, ...]:
    """Candidate effects of a mechanism, without accepted ones and errors of `stated` fields."""
    return tuple(e.candidate(mechanism) for name, e in registry().items()
                 if name not in accepted and e.error_of not in stated
                 and e.applies(mechanism))  # fmt: skip


def describing_terms(mechanism: Mechanism) -> tuple[Candidate, ...]:
    """Generic terms that describe what no effect explains in a mechanism's residuals."""
    return tuple(t.candidate(mechanism) for t in terms.EFFECTS if t.applies(mechanism))


def effect_of(name: str) -> Effect:
    """Effect or descriptive term called `name`."""
    found = registry().get(name)
    return found if found is not None else next(t for t in terms.EFFECTS if t.name == name)


def accepted_parameters(mechanism: Mechanism, accepted: NamedValues) -> Iterator[Parameter]:
    """Base parameters `effect.parameter` by which accepted effects are refitted."""
    for name, values in accepted.items():
        for p in effect_of(name).with_shape(mechanism):
            value = _engine_value(p, values.get(p.name))
            yield replace(p, name=f"{name}.{p.name}", start=value)


def _engine_value(p: Parameter, value: float | None) -> float:
    """Engine's value of a parameter for the stated one; its start if none is stated."""
    if value is None:
        return p.start
    return 1.0 / value if p.inverse else float(value)


def check_effects(accepted: NamedValues, mechanism: Mechanism, origin: str) -> None:
    """Refuse effects and parameters that the library does not have, and values out of range."""
    known = {e.name: e for e in (*registry().values(), *terms.EFFECTS) if e.applies(mechanism)}
    for name, values in accepted.items():
        if name not in known:
            raise ConfigurationError(
                f"{origin}: effects.{name}: unknown effect; allowed: {', '.join(known)}"
            )
        parameters = {p.name: p for p in known[name].with_shape(mechanism)}
        needed = [p.name for p in known[name].parameters(mechanism)]
        if not set(needed) <= set(values) <= set(parameters):
            raise ConfigurationError(
                f"{origin}: effects.{name}: needs {', '.join(needed)}; may have "
                f"{', '.join(k for k in parameters if k not in needed) or 'no other'}"
            )
        for key, value in values.items():
            p = parameters[key]
            if not p.low <= _engine_value(p, value) <= p.high:
                raise ConfigurationError(
                    f"{origin}: effects.{name}.{key}: {value:g} is out of range; "
                    f"allowed: {p.low:g} to {p.high:g} {p.unit}"
                )


def group_by_effect(names: Sequence[str], values: Array) -> dict[str, Array]:
    """Split `values` (k,) of parameters called `effect.parameter` into one array per effect."""
    found: dict[str, list[float]] = {}
    for name, value in zip(names, values, strict=True):
        found.setdefault(name.split(".")[0], []).append(float(value))
    return {name: np.array(v) for name, v in found.items()}


def ordered_values(effect: Effect, mechanism: Mechanism, values: Mapping[str, float]) -> Array:
    """Engine's values (k,) of an effect's parameters in their order, start values if not given."""
    return np.array([_engine_value(p, values.get(p.name)) for p in effect.with_shape(mechanism)])
