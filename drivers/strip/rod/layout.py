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
MASS, LOAD_X, LOAD_Z, DESK, BEND, CUBIC, DAMP, SLIP, STICK, REST, AXIAL, SPAN, FLOOR = range(13)
NATURE = 13

# Work of one Newton iteration.
HAT_X, HAT_Z, BASE_X, BASE_Z, BASE_EPS, TANGENT = range(6)
TURN_X, TURN_Z, PULL_X, PULL_Z, S_XX, S_XZ, S_ZZ, TAUT, GROWTH = range(6, 15)
WORK = 15

INEXTENSIBLE = 1e5  # axial stiffness over weight: 10 ppm of strain under its own weight
SINK = 2e-5  # m over which the desk takes up the weight


def nature(model: StripModel, segments: int) -> Array:
    """The description lumped onto `segments` equal segments -> (segments + 3, NATURE)."""
    mechanics = model.mechanics
    length = mechanics.length
    span = length / segments
    nodes = np.clip((np.arange(segments + 2) - 0.5) * span, 0.0, length)
    rows = np.zeros((segments + 3, NATURE))
    inner = rows[1:-1]
    inner[:, MASS] = mechanics.total(mechanics.linear_density, nodes)
    gx, gz = model.boundary.gravity
    inner[:, LOAD_X] = inner[:, MASS] * gx
    inner[:, LOAD_Z] = inner[:, MASS] * gz
    inner[:, DESK] = -inner[:, LOAD_Z]
    _lump_bending(inner, mechanics, nodes)
    weight = float(inner[:, MASS].sum()) * float(np.hypot(gx, gz))
    rows[:, SPAN] = span
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
