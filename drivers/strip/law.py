"""Generic terms of a strip's equations for residuals that no named effect explains.

A term is a moment, a force or a measurement error as a function of a state variable. A
strip file may hold amounts of terms under `law:`; every engine simulates them, as they
change the model.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_yaml
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


CHANGES: Mapping[str, Apply] = {
    "term_force": _add_force,
    "term_weight": _add_weight_gradient,
    "term_place": _stiffen_towards_grip,
    "term_middle": _stiffen_middle,
    "term_run": _stiffen_with_use,
    "term_set": _add_curl,
    "term_give": _add_compliance,
}


def _term(name: str, stated: Mapping[str, Any]) -> Effect:
    """Build the generic term `name` from what law.yaml has `stated` of it."""
    apply = CHANGES.get(name) or partial(_add, stated["adds_to"])
    most = stated["most"]
    amount = Parameter(
        name="amount",
        unit=stated["unit"],
        start=0.0,
        low=stated.get("least", -most),
        high=most,
        spread=most,
    )
    sizes = tuple(stated["size"] * (most / stated["size"]) ** TRIED)
    return Effect(
        name=name,
        sentence=stated["sentence"],
        of="strip",
        stage=Stage.OBSERVATION,
        parameters=(amount,),
        revealed_by="",
        apply=lambda model, values: apply(model, values["amount"]),
        typical=lambda _: sizes,
    )


LAW_TERMS: Mapping[str, Effect] = MappingProxyType(
    {
        name: _term(name, stated)
        for name, stated in read_yaml(Path(__file__).with_suffix(".yaml")).items()
    }
)
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
