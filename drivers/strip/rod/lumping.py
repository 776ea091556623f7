"""A description lumped onto the nodes of a rod."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from drivers.errors import Unsupported
from drivers.strip.model import BendingLaw, Boundary, Mechanics, StripModel
from drivers.strip.rod import layout as at
from drivers.types import Array

GRADED = 0.1  # share of the segments that grow finer towards the grip
FINEST = 1 / 8  # length of the last of them over that of an equal one
INEXTENSIBLE = 1e6  # axial stiffness over weight: 1 ppm of strain under its own weight
KNOWN = {
    Mechanics: "length width thickness rigidity viscosity rest_curvature linear_density law"
    " adhesion",  # acts once layers touch, where a rod ends
    BendingLaw: "cubic yield_curvature stiffness_ratio",
    Boundary: "gravity",
}


def lattice(length: float, segments: int) -> Array:
    """Arc lengths of the nodes (segments + 1,) [m]: equal segments, finer towards the grip.

    A taut strip bends to the grip's pitch within sqrt(EI / T), a millimetre or two, and where it
    leaves the desk hangs on the length lost in that bend.
    """
    before_grip = (segments - 0.5 - np.arange(segments)) / segments
    spans = np.minimum(1.0, FINEST ** (1.0 - before_grip / GRADED))
    arc = np.concatenate([[0.0], np.cumsum(spans)])
    return np.asarray(arc * (length / arc[-1]))


def nature(model: StripModel, segments: int) -> Array:
    """The description lumped onto `segments` segments -> (segments + 3, NATURE)."""
    mechanics = model.mechanics
    arc = lattice(mechanics.length, segments)
    middles = np.concatenate([[0.0], 0.5 * (arc[1:] + arc[:-1]), [mechanics.length]])
    rows = np.zeros((segments + 3, at.NATURE))
    inner = rows[1:-1]
    gx, gz = model.boundary.gravity
    inner[:, at.MASS] = mechanics.total(mechanics.linear_density, middles)
    inner[:, at.LOAD_X] = inner[:, at.MASS] * gx
    inner[:, at.LOAD_Z] = inner[:, at.MASS] * gz
    inner[:, at.DESK] = -inner[:, at.LOAD_Z]
    _lump_bending(inner, mechanics, middles)
    weight = float(inner[:, at.MASS].sum()) * float(np.hypot(gx, gz))
    spans = np.diff(arc)
    rows[:, at.SPAN] = np.concatenate([spans[:1], spans, spans[-1:], spans[-1:]])
    rows[:, at.SHARE] = rows[:, at.SPAN] / mechanics.length
    rows[:, at.FLOOR] = -weight
    rows[:, at.AXIAL] = INEXTENSIBLE * weight
    return rows


def _lump_bending(inner: Array, mechanics: Mechanics, middles: Array) -> None:
    """Bending at each node between the middles of its segments: compliances in a row add up.

    The first and the last node stand for half a segment, so that clamps are of second order.
    Damping of unlike pieces under one moment: D = K^2 int(viscosity / EI^2) ds.
    """
    reach = np.diff(middles)
    rigidity, law = mechanics.rigidity, mechanics.law
    stiffness = mechanics.series(rigidity, middles) / reach
    inner[:, at.BEND] = stiffness
    inner[:, at.DAMP] = stiffness**2 * mechanics.total(mechanics.viscosity / rigidity**2, middles)
    inner[:, at.CUBIC] = law.cubic / reach**2
    inner[:, at.CREST] = reach / np.sqrt(-3 * law.cubic) if law.cubic < 0 else np.inf
    inner[:, at.SLIP] = law.yield_curvature * stiffness * reach
    inner[:, at.STICK] = law.stiffness_ratio * stiffness
    inner[:, at.REST] = mechanics.total(mechanics.rest_curvature, middles)


def check(models: Sequence[StripModel]) -> None:
    """Raise Unsupported for what a rod cannot represent."""
    for model in models:
        for part in (model.mechanics, model.mechanics.law, model.boundary):
            _check_known(part)
        gx, gz = model.boundary.gravity
        if gz >= 0:
            raise Unsupported("rod", f"gravity ({gx:g}, {gz:g}), which does not press on the desk")
        if abs(model.mechanics.length - model.stated_length) > 1e-9:
            raise Unsupported("rod", "a strip that is not as long as stated")


def _check_known(part: Mechanics | BendingLaw | Boundary) -> None:
    """Refuse fields that the rod does not know, unless they are at their null."""
    for field in fields(part):
        if field.name in KNOWN[type(part)].split():
            continue
        if getattr(part, field.name) != field.default:
            raise Unsupported("rod", field.name)
