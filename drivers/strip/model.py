"""Physical model of a strip and its cell, the common input of all simulation engines.

A model comes from a strip file and the cell's effects. It is independent of any
discretisation: fields along the strip are constant over `CELLS` equal cells, and an
engine lumps them onto its own nodes with `Mechanics.mean` and `Mechanics.total`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from drivers.base.errors import ConfigurationError
from drivers.base.geometry import running_sums
from drivers.base.types import GRAVITY, Array, frozen

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")
CELLS = 600
SOFTEST = 0.05  # of the rigidity that ageing or a law always leaves
AIR_DENSITY = 1.2  # kg/m^3
CONTACT_HEIGHT = 0.001  # m above rest at which desk_contact is defined


@dataclass(frozen=True, slots=True)
class BendingLaw:
    """Deviations of a strip's bending moment from a linear viscoelastic (Kelvin-Voigt)
    law of its curvature.

    A term whose amount is 0 is off. `cubic` [m^2] and `fifth`: M = EI kappa (1 + u +
    fifth u^2) with u = cubic kappa^2, level past the crest where a softening law
    (`cubic` below 0) would fall. `yield_curvature` [1/m]: friction moment over rigidity
    of an elasto-plastic element beside the elastic one, whose stiffness before it
    slides is `stiffness_ratio` times EI; of both, the share `gradual` belongs to an
    element without a yield point, dM/dkappa = K (1 - s M / M_c) with s the sign of the
    curvature's rate (Dahl 1976, AIAA Journal 14(12), of exponent 1).
    `quadratic_damping` [m s^2] times EI |dkappa/dt| dkappa/dt adds to the moment. Of
    the rigidity the share `relaxing` carries its moment only for about
    `relaxation_time` [s] (a Maxwell element, at rest when the motion begins).
    """

    cubic: float = 0.0
    fifth: float = 0.0
    yield_curvature: float = 0.0
    stiffness_ratio: float = 8.0
    gradual: float = 0.0
    quadratic_damping: float = 0.0
    relaxing: float = 0.0
    relaxation_time: float = 1.0

    @property
    def crest(self) -> float:
        """Curvature [1/m] beyond which the elastic bending moment stays constant;
        infinite if it never does.
        """
        if self.cubic >= 0 or 20.0 * self.fifth >= 9.0:
            return math.inf
        # dM/dkappa = 0: the smaller root of 1 + 3 u + 5 fifth u^2, finite at fifth = 0
        # too
        u = -2.0 / (3.0 + math.sqrt(9.0 - 20.0 * self.fifth))
        return math.sqrt(u / self.cubic)


@dataclass(frozen=True, slots=True)
class Drag:
    """Drag [N/m] of still air on a strip, 1/2 rho C_d width (u + slow) (v_n n + along
    v_t t).

    C_d is `coefficient`, u^2 = v_n^2 + oblique v_t^2 of the speeds v_n across and v_t
    along the strip. At `slow` [m/s] friction of the air resists as much as its
    pressure.
    """

    coefficient: float = 0.0
    slow: float = 0.0
    oblique: float = 0.0
    along: float = 0.0


@dataclass(frozen=True, slots=True)
class Mechanics:
    """Mechanical properties of a strip, as scalars and as arrays (CELLS,) over equal
    cells.

    Cell j spans [j, j + 1] length / CELLS. `rigidity` EI [N m^2], `viscosity` [N m^2 s]
    (moment per rate of curvature), `rest_curvature` [1/m], `linear_density` [kg/m], all
    of the whole width. `length` [m] is the true one, at rest. `stretch_stiffness` [N]
    is force per strain, `drag` that of the air, `adhesion` [N/m] the force per length
    along the strip between layers that touch.
    """

    length: float
    width: float
    thickness: float
    rigidity: Array
    viscosity: Array
    rest_curvature: Array
    linear_density: Array
    law: BendingLaw = BendingLaw()
    stretch_stiffness: float = math.inf
    drag: Drag = Drag()
    adhesion: float = 0.0

    @property
    def cells(self) -> Array:
        """Arc lengths (CELLS,) [m] of the middles of the strip's equal cells, from the
        fixed edge.
        """
        return np.asarray((np.arange(CELLS) + 0.5) * (self.length / CELLS))

    @property
    def positions(self) -> Array:
        """Relative arc lengths (CELLS,) of the strip's cells, from -1/2 at the fixed
        edge to 1/2 at the grip.
        """
        return self.cells / self.length - 0.5

    @property
    def ends(self) -> Array:
        """Arc lengths (2,) [m] of the strip's fixed and grasped edges."""
        return np.array([0.0, self.length])

    @property
    def touch_gap(self) -> float:
        """Vertical distance [m] of two layers' midlines at which they touch: the
        thickness, at least 1 mm.
        """
        return max(self.thickness, 0.001)

    @property
    def drag_per_length(self) -> float:
        """Air drag per length of strip over the square of its normal speed
        [N s^2/m^3].
        """
        return 0.5 * AIR_DENSITY * self.drag.coefficient * self.width

    def total(self, values: Array, edges: Array) -> Array:
        """Integrals (n,) of a per-cell field `values` (CELLS,) over the n spans between
        arc lengths `edges` (n + 1,) [m].
        """
        borders = np.linspace(0.0, self.length, len(values) + 1)
        up_to_border = running_sums(values) * (self.length / len(values))
        return np.diff(np.interp(edges, borders, up_to_border))

    def mean(self, values: Array, edges: Array) -> Array:
        """Means (n,) of a per-cell field `values` (CELLS,) over the n spans between arc
        lengths `edges` (n + 1,) [m].
        """
        return self.total(values, edges) / np.diff(edges)

    def series(self, values: Array, edges: Array) -> Array:
        """Harmonic means (n,) of a per-cell field `values` (CELLS,) over the n spans
        between arc lengths `edges` (n + 1,) [m].
        """
        return 1.0 / self.mean(1.0 / values, edges)

    def inside(self, position: float, width: float, softness: float = 0.0) -> Array:
        """Fraction (CELLS,) of each cell inside a window of `width` [m] centred at
        `position` [m].

        With `softness` the edges are smoothed by a Gaussian of deviation softness times
        width. Raises ConfigurationError for a position outside the strip.
        """
        length = self.length
        if not 0 <= position <= length:
            raise ConfigurationError(
                f"position: {position:g} is not on the strip; allowed: 0 to"
                f" {length:g} m"
            )
        if softness > 0:
            from scipy import special

            ahead, behind = (
                self.cells - position + side * width / 2 for side in (1.0, -1.0)
            )
            spread = softness * width
            inside: Array = special.ndtr(ahead / spread) - special.ndtr(behind / spread)
            return inside
        cells = np.linspace(0.0, length, CELLS + 1)
        right = np.minimum(cells[1:], position + width / 2)
        left = np.maximum(cells[:-1], position - width / 2)
        return np.clip((right - left) * (CELLS / length), 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Boundary:
    """Boundary conditions and loads of a strip: `gravity` (g_x, g_z) [m/s^2] in the
    cell frame.

    `edge_friction`: friction coefficient of the loose fixed edge and the part of the
    strip that lies on the desk. `grip_force` [N]: pull along the strip at which it
    slides out of the grip. `grip_compliance` [rad/(N m)]: turn of the grip under the
    strip's moment.
    """

    gravity: tuple[float, float] = (0.0, -GRAVITY)
    edge_friction: float = math.inf
    grip_force: float = math.inf
    grip_compliance: float = 0.0


@dataclass(frozen=True, slots=True)
class Rig:
    """Errors of the reported gripper pose and desk height (true minus reported), and
    the delay of the arm's time stamps.

    `grip_x`, `grip_z` [m] and `grip_tilt` [rad] of the gripper's pose, `desk_height`
    [m] of the desk, `delay` [s] of the gripper's stamps. Applied in `observation`:
    engines get true poses over the true desk.
    """

    grip_x: float = 0.0
    grip_z: float = 0.0
    grip_tilt: float = 0.0
    desk_height: float = 0.0
    delay: float = 0.0


@dataclass(frozen=True, slots=True)
class ObservationModel:
    """Errors of camera and force sensor, measured minus true: positions, delays and
    forces.

    `contact_height` [m] is the height that defines desk_contact. Images show the world
    `camera_latency` [s] before their stamps. Positions in them are 1 + `scale` times
    true, offset by `shift_x`, `shift_z` [m]; contact_x has the additional offset
    `contact_bias` [m]. Force is reported `force_delay` [s] late, with the offsets
    `force_x`, `force_z` [N].
    """

    contact_height: float = CONTACT_HEIGHT
    camera_latency: float = 0.0
    scale: float = 0.0
    shift_x: float = 0.0
    shift_z: float = 0.0
    contact_bias: float = 0.0
    force_delay: float = 0.0
    force_x: float = 0.0
    force_z: float = 0.0


@dataclass(frozen=True, slots=True)
class StripModel:
    """Physical model of a strip in a cell: mechanics, boundary conditions and the
    cell's errors.

    `stated_length` [m] is x = L, where the gripper grasps the edge; a strip of another
    length starts slack or taut. `index` is the number of earlier runs of the specimen.
    """

    mechanics: Mechanics
    stated_length: float
    boundary: Boundary = field(default_factory=Boundary)
    rig: Rig = field(default_factory=Rig)
    observation: ObservationModel = field(default_factory=ObservationModel)
    index: int = 0


def with_field(part: T, path: str, value: Any) -> T:
    """Copy of the dataclass `part` with `value` in the field at the dotted `path`, such
    as "mechanics.law.cubic".
    """
    name, _, inner = path.partition(".")
    if inner:
        value = with_field(getattr(part, name), inner, value)
    return replace(part, **{name: value})


def with_added(model: StripModel, path: str, change: Array | float) -> StripModel:
    """Copy of `model` with `change`, a scalar or an array (CELLS,), added to the field
    at the dotted `path`.
    """
    value = attrgetter(path)(model) + change
    return with_field(model, path, frozen(value) if np.ndim(value) else value)


def scale_rigidity(model: StripModel, factor: Array | float) -> StripModel:
    """Copy of `model` with its bending rigidity and viscosity multiplied by `factor`, a
    scalar or an array (CELLS,).
    """
    mechanics = model.mechanics
    rigidity = frozen(mechanics.rigidity * factor)
    viscosity = frozen(mechanics.viscosity * factor)
    scaled = replace(mechanics, rigidity=rigidity, viscosity=viscosity)
    return replace(model, mechanics=scaled)


Effects = Mapping[str, Mapping[str, float]]
