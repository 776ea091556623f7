"""Where the numbers of a rod stand, and how a description is lumped onto its nodes.

Arrays are (rows, fields[, WIDTH]). Row r is node r - 1: row 1 the fixed edge, row N + 1 the
grasped edge; rows 0 and N + 2 are ghosts, one element beyond the ends, that hold the tangents.
Segment r runs from row r to row r + 1.
"""

from collections.abc import Sequence

import numpy as np

from drivers.errors import Unsupported
from drivers.strip.model import Boundary, Mechanics, StripModel
from drivers.types import Array

# State: position, velocity, strain of bending and friction moment now, and one step before.
X, Z, VX, VZ, EPS, FRICTION = range(6)
X1, Z1, VX1, VZ1, EPS1, TENSION = range(6, 12)
STATE = 12

# Nature: of the node (mass [kg], weight [N], bending) and of the segment that begins there.
MASS, LOAD_X, LOAD_Z, DESK, BEND, CUBIC, DAMP, SLIP, STICK, REST = range(10)
AXIAL, SPAN, SHARE, FLOOR = range(10, 14)
NATURE = 14

# Work of one Newton iteration.
HAT_X, HAT_Z, BASE_X, BASE_Z, BASE_EPS, TANGENT = range(6)
TURN_X, TURN_Z, PULL_X, PULL_Z, S_XX, S_XZ, S_ZZ, TAUT, GROWTH = range(6, 15)
WORK = 15

GRADED = 0.1  # share of the segments that grow finer towards the grip
FINEST = 1 / 8  # length of the last of them over that of an equal one
INEXTENSIBLE = 1e6  # axial stiffness over weight
SINK = 2e-5  # m over which the desk takes up the weight


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
    nodes = np.concatenate([[0.0], 0.5 * (arc[1:] + arc[:-1]), [mechanics.length]])
    rows = np.zeros((segments + 3, NATURE))
    inner = rows[1:-1]
    inner[:, MASS] = mechanics.total(mechanics.linear_density, nodes)
    gx, gz = model.boundary.gravity
    inner[:, LOAD_X] = inner[:, MASS] * gx
    inner[:, LOAD_Z] = inner[:, MASS] * gz
    inner[:, DESK] = -inner[:, LOAD_Z]
    _lump_bending(inner, mechanics, nodes)
    weight = float(inner[:, MASS].sum()) * float(np.hypot(gx, gz))
    spans = np.diff(arc)
    rows[:, SPAN] = np.concatenate([spans[:1], spans, spans[-1:], spans[-1:]])
    rows[:, SHARE] = rows[:, SPAN] / mechanics.length
    rows[:, FLOOR] = -weight
    rows[:, AXIAL] = INEXTENSIBLE * weight
    return rows


def _lump_bending(inner: Array, mechanics: Mechanics, nodes: Array) -> None:
    """Bending at each node over its half segments: compliances in a row add up.

    Damping of unlike pieces under one moment: D = K^2 int(viscosity / EI^2) ds.
    """
    reach = np.diff(nodes)
    rigidity = mechanics.rigidity
    stiffness = mechanics.series(rigidity, nodes) / reach
    law = mechanics.law
    inner[:, BEND] = stiffness
    inner[:, DAMP] = stiffness**2 * mechanics.total(mechanics.viscosity / rigidity**2, nodes)
    inner[:, CUBIC] = law.cubic / reach**2
    inner[:, SLIP] = law.yield_curvature * stiffness * reach
    inner[:, STICK] = law.stiffness_ratio * stiffness
    inner[:, REST] = mechanics.total(mechanics.rest_curvature, nodes)


def check(models: Sequence[StripModel]) -> None:
    """Raise Unsupported for what a rod cannot represent."""
    for model in models:
        if model.boundary.gravity[1] >= 0:
            raise Unsupported("rod", f"gravity {model.boundary.gravity} that does not press down")
        unknown = _fields(model.mechanics, Mechanics) | _fields(model.boundary, Boundary)
        if unknown:
            raise Unsupported("rod", f"the description's {', '.join(sorted(unknown))}")


_KNOWN = {
    Mechanics: "length width thickness rigidity viscosity rest_curvature linear_density law",
    Boundary: "gravity",
}


def _fields(part: object, kind: type) -> set[str]:
    return set(kind.__dataclass_fields__) - set(_KNOWN[kind].split())  # type: ignore[attr-defined]
