"""Generic terms of a strip's equations for residuals that no named effect explains.

A term is a moment, a force or a measurement error as a function of a state variable. A
strip file may hold amounts of terms under `law:`; every engine simulates them, as they
change the model.
"""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array, frozen
from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import (
    SOFTEST,
    StripModel,
    scale_rigidity,
    with_added,
    with_field,
)

# between a term's size and its maximum, on a logarithmic scale
TRIED = np.array([0.0, 0.5, 0.9])
Apply = Callable[[StripModel, float], StripModel]


def _term(
    name: str,
    sentence: str,
    unit: str,
    size: float,
    most: float,
    apply: Apply | str,
    least: float | None = None,
) -> Effect:
    """Build the generic term `name`, whose amount lies between `least` (by default
    -`most`) and `most`; an amount of `size` shows in ten runs.

    `apply(model, amount)` is a copy of the model with the term; a dotted path names the
    field to which it is added.
    """
    if isinstance(apply, str):
        apply = partial(_add, apply)
    low = -most if least is None else least
    amount = Parameter(
        name="amount", unit=unit, start=0.0, low=low, high=most, spread=most
    )
    sizes = tuple(size * (most / size) ** TRIED)
    return Effect(
        name=name,
        sentence=sentence,
        of="strip",
        stage=Stage.OBSERVATION,
        parameters=(amount,),
        revealed_by="",
        apply=lambda model, values: apply(model, values["amount"]),
        typical=lambda _: sizes,
    )


def _add(path: str, model: StripModel, amount: float) -> StripModel:
    return with_added(model, path, amount)


def _add_force(model: StripModel, amount: float) -> StripModel:
    gx, gz = model.boundary.gravity
    return with_field(model, "boundary.gravity", (gx + amount, gz))


def _add_curl(model: StripModel, amount: float) -> StripModel:
    return with_added(model, "mechanics.rest_curvature", amount * _position(model))


def _add_weight_gradient(model: StripModel, amount: float) -> StripModel:
    density = model.mechanics.linear_density * (1.0 + amount * _position(model))
    return with_field(model, "mechanics.linear_density", frozen(density))


def _add_compliance(model: StripModel, amount: float) -> StripModel:
    stiffness = 1.0 / (1.0 / model.mechanics.stretch_stiffness + amount)
    return with_field(model, "mechanics.stretch_stiffness", stiffness)


def _stiffen_towards_grip(model: StripModel, amount: float) -> StripModel:
    return scale_rigidity(model, 1.0 + amount * _position(model))


def _stiffen_middle(model: StripModel, amount: float) -> StripModel:
    # 1 in the middle of the strip, 0 at its ends
    arch = 1.0 - 4.0 * _position(model) ** 2
    return scale_rigidity(model, 1.0 + amount * arch)


def _stiffen_with_use(model: StripModel, amount: float) -> StripModel:
    return scale_rigidity(model, max(SOFTEST, 1.0 + amount * model.index))


def _position(model: StripModel) -> Array:
    """Relative arc lengths (CELLS,) of the strip model's cells, from -1/2 at the fixed
    edge to 1/2 at the grip.
    """
    return model.mechanics.positions


_TERMS = (
    _term(
        name="term_curvature",
        sentence="moment over stiffness as curvature^3",
        unit="m^2",
        size=2e-5,
        most=1e-3,
        least=-5e-6,
        apply="mechanics.law.cubic",
    ),
    _term(
        name="term_rate",
        sentence="moment over stiffness as rate of curvature squared",
        unit="m s^2",
        size=1e-4,
        most=0.01,
        least=0.0,
        apply="mechanics.law.quadratic_damping",
    ),
    _term(
        name="term_sign",
        sentence="moment over stiffness as the sign of the rate",
        unit="1/m",
        size=0.5,
        most=100.0,
        least=0.0,
        apply="mechanics.law.yield_curvature",
    ),
    _term(
        name="term_fading",
        sentence="share of the moment that fades within a second",
        unit="1",
        size=0.03,
        most=0.8,
        least=0.0,
        apply="mechanics.law.relaxing",
    ),
    _term(
        name="term_speed",
        sentence="force as normal speed squared",
        unit="1",
        size=0.5,
        most=10.0,
        least=0.0,
        apply="mechanics.drag.coefficient",
    ),
    _term(
        name="term_force",
        sentence="steady force along the desk per mass",
        unit="m/s^2",
        size=0.05,
        most=2.0,
        apply=_add_force,
    ),
    _term(
        name="term_weight",
        sentence="weight growing towards the grip",
        unit="1",
        size=0.05,
        most=1.8,
        apply=_add_weight_gradient,
    ),
    _term(
        name="term_place",
        sentence="stiffness growing towards the grip",
        unit="1",
        size=0.2,
        most=1.8,
        apply=_stiffen_towards_grip,
    ),
    _term(
        name="term_middle",
        sentence="stiffness greater in the middle",
        unit="1",
        size=0.2,
        most=5.0,
        least=-0.9,
        apply=_stiffen_middle,
    ),
    _term(
        name="term_run",
        sentence="stiffness growing with the run",
        unit="1",
        size=0.005,
        most=0.3,
        apply=_stiffen_with_use,
    ),
    _term(
        name="term_even",
        sentence="rest curvature everywhere",
        unit="1/m",
        size=0.5,
        most=30.0,
        apply="mechanics.rest_curvature",
    ),
    _term(
        name="term_set",
        sentence="rest curvature growing towards the grip",
        unit="1/m",
        size=1.0,
        most=30.0,
        apply=_add_curl,
    ),
    _term(
        name="term_length",
        sentence="strip longer than stated",
        unit="m",
        size=3e-4,
        most=0.02,
        apply="mechanics.length",
    ),
    _term(
        name="term_give",
        sentence="strip longer by its pull",
        unit="1/N",
        size=0.01,
        most=2.0,
        least=0.0,
        apply=_add_compliance,
    ),
    _term(
        name="term_clock",
        sentence="images older than their stamps",
        unit="s",
        size=0.003,
        most=0.1,
        apply="observation.camera_latency",
    ),
    _term(
        name="term_side",
        sentence="images shifted along the desk",
        unit="m",
        size=3e-4,
        most=0.03,
        apply="observation.shift_x",
    ),
    _term(
        name="term_view",
        sentence="images shifted upwards",
        unit="m",
        size=3e-4,
        most=0.03,
        apply="observation.shift_z",
    ),
    _term(
        name="term_contact",
        sentence="contacts seen farther along the desk",
        unit="m",
        size=5e-4,
        most=0.03,
        apply="observation.contact_bias",
    ),
    _term(
        name="term_zoom",
        sentence="images magnified",
        unit="1",
        size=5e-4,
        most=0.05,
        apply="observation.scale",
    ),
    _term(
        name="term_reach",
        sentence="grip farther along the desk than the arm reports",
        unit="m",
        size=3e-4,
        most=0.03,
        apply="rig.grip_x",
    ),
    _term(
        name="term_lift",
        sentence="grip higher than the arm reports",
        unit="m",
        size=3e-4,
        most=0.03,
        apply="rig.grip_z",
    ),
)
LAW_TERMS: Mapping[str, Effect] = MappingProxyType({term.name: term for term in _TERMS})
"""The generic terms by name, in the order in which they apply."""


def with_law(model: StripModel, amounts: Mapping[str, float]) -> StripModel:
    """Copy of `model` with `amounts` of generic terms added, by name; unknown ones are
    ignored.
    """
    for name, term in LAW_TERMS.items():
        if name in amounts:
            model = term.apply_to(model, {"amount": amounts[name]})
    return model


def check_law(amounts: Mapping[str, float], origin: str) -> None:
    """Raise ConfigurationError for an unknown generic term or an amount outside its
    range.
    """
    for name, amount in amounts.items():
        if name not in LAW_TERMS:
            raise ConfigurationError(
                f"{origin}: law.{name}: is unknown; allowed: {', '.join(LAW_TERMS)}"
            )
        LAW_TERMS[name].check({"amount": amount}, f"{origin}: law.{name}")
