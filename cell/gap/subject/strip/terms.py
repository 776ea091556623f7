"""Terms that describe, and never name, what no effect of the library explains."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.subject.subject import Candidate, Parameter
from drivers.strip.model import BendingLaw, Mechanics, StripModel
from drivers.types import Array, frozen

LARGER = 10.0  # times its size: the farthest that a term is taken


@dataclass(frozen=True, slots=True)
class Term:
    """A moment or force by what it grows with: `size` of its amount just shows in ten runs."""

    name: str
    sentence: str
    unit: str
    size: float
    added: Callable[[StripModel, float], StripModel]

    def candidate(self) -> Candidate:
        """As the engine tries it."""
        reach = LARGER * self.size
        amount = Parameter("amount", self.unit, 0.0, -reach, reach, 0.1 * self.size, reach)
        return Candidate(self.name, self.sentence, "strip", (amount,), (((self.size,),),))


def _law(model: StripModel, change: Callable[[BendingLaw], BendingLaw]) -> StripModel:
    return replace(model, mechanics=replace(model.mechanics, law=change(model.mechanics.law)))


def _curvature(model: StripModel, amount: float) -> StripModel:
    return _law(model, lambda law: replace(law, cubic=law.cubic + amount))


def _rate(model: StripModel, amount: float) -> StripModel:
    return _law(model, lambda law: replace(law, quadratic_damping=law.quadratic_damping + amount))


def _sign(model: StripModel, amount: float) -> StripModel:
    return _law(model, lambda law: replace(law, yield_curvature=law.yield_curvature + amount))


def _speed(model: StripModel, amount: float) -> StripModel:
    drag = model.mechanics.drag
    more = replace(drag, coefficient=drag.coefficient + amount)
    return replace(model, mechanics=replace(model.mechanics, drag=more))


def _force(model: StripModel, amount: float) -> StripModel:
    gx, gz = model.boundary.gravity
    return replace(model, boundary=replace(model.boundary, gravity=(gx + amount, gz)))


def _place(model: StripModel, amount: float) -> StripModel:
    return replace(model, mechanics=model.mechanics.stiffened(1.0 + amount * _along(model)))


def _run(model: StripModel, amount: float) -> StripModel:
    factor = np.full_like(model.mechanics.rigidity, max(0.05, 1.0 + amount * model.index))
    return replace(model, mechanics=model.mechanics.stiffened(factor))


def _set(model: StripModel, amount: float) -> StripModel:
    strip: Mechanics = model.mechanics
    rest = frozen(strip.rest_curvature + amount * _along(model))
    return replace(model, mechanics=replace(strip, rest_curvature=rest))


def _along(model: StripModel) -> Array:
    """Place along the strip from -1/2 to 1/2 (CELLS,)."""
    return np.asarray(model.mechanics.cells / model.mechanics.length - 0.5)


TERMS = (
    Term("term_curvature", "moment over stiffness as curvature^3", "m^2", 2e-5, _curvature),
    Term("term_rate", "moment over stiffness as rate of curvature squared", "m s^2", 1e-4, _rate),
    Term("term_sign", "moment over stiffness as the sign of the rate", "1/m", 0.5, _sign),
    Term("term_speed", "force as normal speed squared", "1", 0.5, _speed),
    Term("term_force", "steady force along the desk per mass", "m/s^2", 0.05, _force),
    Term("term_place", "stiffness growing towards the grip", "1", 0.2, _place),
    Term("term_run", "stiffness growing with the run", "1", 0.005, _run),
    Term("term_set", "rest curvature growing towards the grip", "1/m", 1.0, _set),
)


def with_terms(model: StripModel, amounts: dict[str, float]) -> StripModel:
    """`model` with the named terms added."""
    for term in TERMS:
        if amounts.get(term.name):
            model = term.added(model, amounts[term.name])
    return model
