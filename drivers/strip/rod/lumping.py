"""Lumping of a strip model onto the nodes and segments of a rod."""

from collections.abc import Sequence

import numpy as np

from drivers.base.errors import Unsupported
from drivers.base.types import Array
from drivers.strip.engine import graded_nodes
from drivers.strip.model import Mechanics, StripModel
from drivers.strip.rod import layout as at

GRADED = 0.1  # share of the segments that grow finer towards the grip
FINEST = 1 / 8  # length of the last of them over that of an equal one
INEXTENSIBLE = 1e6  # axial stiffness over weight: 1 ppm of strain under its own weight


def lattice(length: float, segments: int) -> Array:
    """Arc lengths (segments + 1,) [m] of a rod's nodes: equal segments, finer near the
    grip.
    """
    return graded_nodes(length, segments, GRADED, FINEST)


def needs_terms(model: StripModel) -> bool:
    """Whether a strip model has effects that only the optional force terms (module
    `terms`) simulate.
    """
    law = model.mechanics.law
    has_history = law.quadratic_damping != 0 or law.relaxing != 0 or law.gradual != 0
    can_slide = min(model.boundary.edge_friction, model.boundary.grip_force) < np.inf
    return has_history or can_slide or model.mechanics.drag.coefficient != 0


def lump(model: StripModel, segments: int, *, rich: bool = False) -> Array:
    """Coefficients (segments + 3, NATURE) of the nodes and segments of a rod that
    simulates the strip `model`.

    If `rich`, RICH_NATURE of each: also of drag, sliding, relaxation and gradual
    friction.
    """
    boundary = model.boundary
    mechanics = model.mechanics
    arc = lattice(mechanics.length, segments)
    middles = np.concatenate([[0.0], 0.5 * (arc[1:] + arc[:-1]), [mechanics.length]])
    rows = np.zeros((segments + 3, at.RICH_NATURE if rich else at.NATURE))
    nodes = rows[1:-1]  # without the ghosts

    mass = mechanics.total(mechanics.linear_density, middles)
    nodes[:, at.MASS] = mass
    nodes[:, [at.LOAD_X, at.LOAD_Z]] = np.outer(mass, boundary.gravity)
    nodes[:, at.DESK] = -nodes[:, at.LOAD_Z]
    _lump_bending(nodes, mechanics, middles)
    _combine_compliances(nodes[-1], boundary.grip_compliance)

    weight = float(mass.sum()) * float(np.hypot(*boundary.gravity))
    axial = min(INEXTENSIBLE * weight, mechanics.stretch_stiffness)
    # ghost segments equal those beside them
    spans = np.pad(np.diff(arc), (1, 2), mode="edge")
    rows[:, at.SPAN] = spans
    rows[:, at.SHARE] = spans / mechanics.length
    rows[:, at.STRETCH] = axial / spans
    rows[:, at.FLOOR] = -weight

    if rich:
        _lump_terms(rows, model, np.diff(middles))
    return rows


def _lump_bending(inner: Array, mechanics: Mechanics, middles: Array) -> None:
    """Write the bending coefficients of each rod node into its row of `inner`, from the
    strip between the middles of its segments.

    Compliances in series add up. The first and the last node stand for half a segment,
    so that clamps are second-order accurate. Damping of unlike pieces under one moment:
    D = K^2 int(viscosity / EI^2) ds.
    """
    reach = np.diff(middles)
    rigidity = mechanics.rigidity
    law = mechanics.law
    stiffness = mechanics.series(rigidity, middles) / reach
    inner[:, at.BEND] = stiffness
    inner[:, at.DAMP] = stiffness**2 * mechanics.total(
        mechanics.viscosity / rigidity**2, middles
    )
    inner[:, at.CUBIC] = law.cubic / reach**2
    inner[:, at.FIFTH] = law.fifth
    inner[:, at.CREST] = reach * law.crest
    inner[:, at.SLIP] = law.yield_curvature * stiffness * reach
    inner[:, at.STICK] = law.stiffness_ratio * stiffness
    inner[:, at.REST] = mechanics.total(mechanics.rest_curvature, middles)


def _combine_compliances(grip: Array, compliance: float) -> None:
    """Put the gripper's `compliance` [rad/(N m)] in series with the strip's bending, in
    the coefficients `grip` of the gripped node.

    Angles add under one moment: K' = K / (1 + C K); with s = K' / K the strip's share
    of the angle, damping is s^2 D, the cubic term s^3 of itself, friction s F; while it
    sticks, s is smaller.
    """
    fraction = 1.0 / (1.0 + compliance * grip[at.BEND])
    stuck = 1.0 / (1.0 + compliance * (grip[at.BEND] + grip[at.STICK]))
    grip[at.BEND] *= fraction
    grip[at.STICK] *= fraction * stuck
    grip[at.SLIP] *= fraction
    grip[at.DAMP] *= fraction**2
    grip[at.CUBIC] *= fraction**3
    grip[at.CREST] /= fraction**1.5


def _lump_terms(rows: Array, model: StripModel, reach: Array) -> None:
    """Write the coefficients of drag, sliding, relaxation and gradual friction of nodes
    that are `reach` (nodes,) [m] long into `rows`.
    """
    mechanics = model.mechanics
    law = mechanics.law
    boundary = model.boundary
    inner = rows[1:-1]

    inner[:, at.QUADRATIC] = inner[:, at.BEND] * law.quadratic_damping / reach
    grip_share = 1.0 - boundary.grip_compliance * inner[-1, at.BEND]
    inner[-1, at.QUADRATIC] *= grip_share**2
    inner[:, at.BRANCH] = inner[:, at.BEND] * law.relaxing
    inner[:, at.BEND] -= inner[:, at.BRANCH]
    inner[:, at.FADE] = 1.0 / law.relaxation_time

    drag = mechanics.drag
    inner[:, at.DRAG] = mechanics.drag_per_length * reach
    inner[:, at.SLOW : at.ALONG + 1] = drag.slow, drag.oblique, drag.along

    rows[:, at.GRIPPED] = np.inf
    # the last segment, before the grip and its ghost
    rows[-3, at.GRIPPED] = boundary.grip_force
    inner[:, at.CLING] = boundary.edge_friction

    # an element without a yield point
    if law.gradual != 0 and law.yield_curvature != 0:
        inner[:, at.GRADUAL_PACE] = inner[:, at.STICK] / inner[:, at.SLIP]
        inner[:, at.GRADUAL_SLIP] = law.gradual * inner[:, at.SLIP]
        inner[:, [at.STICK, at.SLIP]] *= 1.0 - law.gradual


def check(models: Sequence[StripModel]) -> None:
    """Raise Unsupported for a strip model in `models` that a rod cannot represent."""
    for model in models:
        gx, gz = model.boundary.gravity
        if gz >= 0:
            raise Unsupported(
                "rod", f"gravity ({gx:g}, {gz:g}), which does not press on the desk"
            )
