"""Library of effects of mechanisms, a family in each file, and checks of accepted ones.

Further effects come from plug-ins, entry points in the group
`folding_cell.mechanism_effects`.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, per_joint
from cell.gap.subject.mechanism.effects import bodies, compliance, drives, friction
from cell.gap.subject.mechanism.effects.drives import bias_law
from cell.gap.subject.mechanism.model import MODES, PRESCRIBED, Mechanism
from cell.gap.subject.mechanism.passive import Torques
from cell.gap.subject.subject import Candidate
from drivers.base.errors import ConfigurationError
from drivers.base.plugins import plugins
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter, check_values


def _cubic(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque (m,) [N m] -c v^3 of cubic damping at rates `v` (m,)."""
    return -p[at] * v**3


def _cubic_spring(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque (m,) [N m] -c q^3 of a cubic spring at angles `q` (m,)."""
    return -p[at] * q**3


def _bent_viscous(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque (m,) [N m] -c |q| v of viscous friction that grows with the angle `q`
    (m,).
    """
    return -p[at] * abs(q) * v


def _load_dry(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque (m,) [N m] -c |load| sign(v), the sign smoothed over the rate `p[1]`."""
    return -p[at] * abs(load) * v / (abs(v) + p[1])


def _term(
    name: str,
    sentence: str,
    law: Callable[..., Array],
    size: Callable[[Mechanism], Array],
    modes: Collection[str] = MODES,
) -> Effect:
    """Descriptive effect by a torque `law` of one parameter per joint, typically 0.01
    `size`.
    """
    return Effect(
        f"term_{name}",
        sentence,
        lambda m: per_joint(m, "torque", "N m", 0.01 * size(m), signed=True),
        "",
        law=law,
        modes=modes,
    )


TERMS = (
    _term("constant", "a steady torque", bias_law, lambda m: m.torque),
    _term("cubic", "rate^3", _cubic, lambda m: m.torque / m.rate**3),
    _term("cubic_spring", "angle^3", _cubic_spring, lambda m: m.torque),
    _term("bent_viscous", "|angle| rate", _bent_viscous, lambda m: m.torque / m.rate),
    _term(
        "load_dry",
        "|load| sign(rate)",
        _load_dry,
        lambda m: m.torque / m.torque,
        (PRESCRIBED.name,),
    ),
)
"""Generic joint torques that describe unexplained residuals and are never named as
causes.
"""


@cache
def registry() -> Mapping[str, Effect]:
    """Effects of mechanisms by name: those of the library, and those of plug-ins."""
    families = map(vars, (bodies, compliance, drives, friction))
    known = {e.name: e for f in families for e in f.values() if isinstance(e, Effect)}
    return dict(
        sorted({**known, **plugins("mechanism_effects", Effect, known)}.items())
    )


@cache
def library() -> Mapping[str, Effect]:
    """Effects of mechanisms and descriptive terms by name."""
    return {**registry(), **{term.name: term for term in TERMS}}


@cache
def torques() -> Torques:
    """Joint-torque laws of all effects and descriptive terms, compiled together."""
    return Torques(
        [(e.name, e.law, e.keys) for e in library().values() if e.law is not None]
    )


def candidates(mechanism: Mechanism) -> tuple[Candidate, ...]:
    """Candidate effects of `mechanism`, without accepted ones and errors of uncertain
    fields.
    """
    file = mechanism.file
    uncertain = {spec.field for spec in file.uncertain}
    return tuple(
        e.candidate(mechanism)
        for name, e in registry().items()
        if name not in file.effects
        and e.error_of not in uncertain
        and e.applies(mechanism)
    )


def accepted_parameters(mechanism: Mechanism) -> Iterator[Parameter]:
    """Base parameters `effect.parameter` by which accepted effects are fitted again."""
    for name, values in mechanism.file.effects.items():
        effect = library()[name]
        starts = ordered_values(effect, mechanism, values)
        for p, start in zip(effect.with_shape(mechanism), starts, strict=True):
            yield replace(p, name=f"{name}.{p.name}", start=float(start))


def check_effects(mechanism: Mechanism) -> None:
    """Refuse accepted effects that `mechanism` cannot have, and values out of range."""
    known = {name: e for name, e in library().items() if e.applies(mechanism)}
    for name, values in mechanism.file.effects.items():
        origin = f"{mechanism.path}: effects.{name}"
        if name not in known:
            raise ConfigurationError(
                f"{origin}: unknown effect; allowed: {', '.join(known)}"
            )
        amounts = known[name].parameters(mechanism)
        check_values(
            values, amounts, known[name].with_shape(mechanism)[len(amounts) :], origin
        )


def ordered_values(
    effect: Effect, mechanism: Mechanism, values: Mapping[str, float]
) -> Array:
    """Values (k,) of an effect's parameters in their order; start values where not
    given.
    """
    parameters = effect.with_shape(mechanism)
    return np.array(
        [
            p.stated_value(values[p.name]) if p.name in values else p.start
            for p in parameters
        ]
    )
