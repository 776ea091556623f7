"""Generic terms of a strip's equations for residuals that no named effect explains.

A term is a moment, a force or a measurement error as a function of a state variable. A strip file
may hold amounts of terms under `law:`; every engine simulates them, as they change the model.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from types import MappingProxyType

import numpy as np

from drivers.errors import ConfigurationError
from drivers.strip.model import SOFTEST, StripModel, scale_rigidity, with_field
from drivers.types import Array, frozen


@dataclass(frozen=True, slots=True)
class Term:
    """Generic term of a strip's equations: its unit, its range and the model field it changes.

    `size` [unit] is the smallest amount visible in ten runs, `most` the largest of any strip,
    `least` the lowest (`-most` unless stated). `added` is the path of the model's field to which
    the amount is added, or a function that applies it to a model.
    """

    name: str
    sentence: str
    unit: str
    size: float
    most: float
    added: str | Callable[[StripModel, float], StripModel]
    least: float | None = None

    @property
    def low(self) -> float:
        """Lowest allowed amount, in `unit`."""
        return -self.most if self.least is None else self.least


def _add_force(model: StripModel, amount: float) -> StripModel:
    gx, gz = model.boundary.gravity
    return with_field(model, "boundary.gravity", (gx + amount, gz))


def _add_curl(model: StripModel, amount: float) -> StripModel:
    rest = model.mechanics.rest_curvature + amount * _position(model)
    return with_field(model, "mechanics.rest_curvature", frozen(rest))


def _add_weight_gradient(model: StripModel, amount: float) -> StripModel:
    density = model.mechanics.linear_density * (1.0 + amount * _position(model))
    return with_field(model, "mechanics.linear_density", frozen(density))


def _add_compliance(model: StripModel, amount: float) -> StripModel:
    stiffness = 1.0 / (1.0 / model.mechanics.stretch_stiffness + amount)
    return with_field(model, "mechanics.stretch_stiffness", stiffness)


def _position(model: StripModel) -> Array:
    """Relative arc length (CELLS,) of the cells, from -1/2 at the fixed edge to 1/2 at the grip."""
    return np.asarray(model.mechanics.cells / model.mechanics.length - 0.5)


def _arch(model: StripModel) -> Array:
    """Parabola (CELLS,) over the cells: 1 in the middle of the strip, 0 at its ends."""
    return np.asarray(1.0 - 4.0 * _position(model) ** 2)


_TERMS = (
    Term("term_curvature", "moment over stiffness as curvature^3", "m^2", 2e-5, 1e-3,
         "mechanics.law.cubic", least=-5e-6),
    Term("term_rate", "moment over stiffness as rate of curvature squared", "m s^2", 1e-4, 0.01,
         "mechanics.law.quadratic_damping", least=0.0),
    Term("term_sign", "moment over stiffness as the sign of the rate", "1/m", 0.5, 100.0,
         "mechanics.law.yield_curvature", least=0.0),
    Term("term_fading", "share of the moment that fades within a second", "1", 0.03, 0.8,
         "mechanics.law.relaxing", least=0.0),
    Term("term_speed", "force as normal speed squared", "1", 0.5, 10.0,
         "mechanics.drag.coefficient", least=0.0),
    Term("term_force", "steady force along the desk per mass", "m/s^2", 0.05, 2.0, _add_force),
    Term("term_weight", "weight growing towards the grip", "1", 0.05, 1.8, _add_weight_gradient),
    Term("term_place", "stiffness growing towards the grip", "1", 0.2, 1.8,
         lambda model, amount: scale_rigidity(model, 1.0 + amount * _position(model))),
    Term("term_middle", "stiffness greater in the middle", "1", 0.2, 5.0,
         lambda model, amount: scale_rigidity(model, 1.0 + amount * _arch(model)), least=-0.9),
    Term("term_run", "stiffness growing with the run", "1", 0.005, 0.3,
         lambda model, amount: scale_rigidity(model, max(SOFTEST, 1.0 + amount * model.index))),
    Term("term_even", "rest curvature everywhere", "1/m", 0.5, 30.0, "mechanics.rest_curvature"),
    Term("term_set", "rest curvature growing towards the grip", "1/m", 1.0, 30.0, _add_curl),
    Term("term_length", "strip longer than stated", "m", 3e-4, 0.02, "mechanics.length"),
    Term("term_give", "strip longer by its pull", "1/N", 0.01, 2.0, _add_compliance, least=0.0),
    Term("term_clock", "images older than their stamps", "s", 0.003, 0.1,
         "observation.camera_latency"),
    Term("term_side", "images shifted along the desk", "m", 3e-4, 0.03, "observation.shift_x"),
    Term("term_view", "images shifted upwards", "m", 3e-4, 0.03, "observation.shift_z"),
    Term("term_contact", "contacts seen farther along the desk", "m", 5e-4, 0.03,
         "observation.contact_bias"),
    Term("term_zoom", "images magnified", "1", 5e-4, 0.05, "observation.scale"),
    Term("term_reach", "grip farther along the desk than the arm reports", "m", 3e-4, 0.03,
         "rig.grip_x"),
    Term("term_lift", "grip higher than the arm reports", "m", 3e-4, 0.03, "rig.grip_z"),
)  # fmt: skip
LAW_TERMS: Mapping[str, Term] = MappingProxyType({term.name: term for term in _TERMS})
"""The generic terms by name, in the order in which they apply."""


def with_law(model: StripModel, amounts: Mapping[str, float]) -> StripModel:
    """Copy of `model` with `amounts` of generic terms added, by name; unknown ones are ignored."""
    for name, term in LAW_TERMS.items():
        if amount := amounts.get(name):
            if isinstance(term.added, str):
                total = attrgetter(term.added)(model) + amount
                model = with_field(model, term.added, total)
            else:
                model = term.added(model, amount)
    return model


def check_law(amounts: Mapping[str, float], origin: str) -> None:
    """Raise ConfigurationError for an unknown generic term or an amount outside its range."""
    for name, amount in amounts.items():
        if name not in LAW_TERMS:
            raise ConfigurationError(
                f"{origin}: law.{name}: is unknown; allowed: {', '.join(LAW_TERMS)}"
            )
        term = LAW_TERMS[name]
        if not term.low <= amount <= term.most:
            raise ConfigurationError(
                f"{origin}: law.{name}: {amount:g} is out of range; "
                f"allowed: {term.low:g} to {term.most:g} {term.unit}"
            )
