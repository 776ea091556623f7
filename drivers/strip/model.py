"""The physical description of a strip in a cell, which every engine consumes.

A description comes from a strip file and the cell's effects and nothing else. It is independent
of any discretisation: fields along the strip are constant over `CELLS` equal cells, and an
engine lumps them onto its own nodes with `Mechanics.mean` and `Mechanics.total`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from drivers.strip.file import GRAVITY, StripFile
from drivers.types import Array, frozen

CELLS = 600
CONTACT_HEIGHT = 0.001  # m above rest at which the lifted strip leaves the desk


@dataclass(frozen=True, slots=True)
class BendingLaw:
    """Moment of curvature beyond the linear Kelvin-Voigt law; nulls switch a term off.

    `cubic` [m^2]: M = EI kappa (1 + cubic kappa^2), level past the crest where a softening law
    (`cubic` below 0) would fall. `yield_curvature` [1/m]: friction moment over rigidity of an
    elasto-plastic element beside the elastic one, whose stiffness before it slides is
    `stiffness_ratio` times EI.
    """

    cubic: float = 0.0
    yield_curvature: float = 0.0
    stiffness_ratio: float = 8.0


@dataclass(frozen=True, slots=True)
class Mechanics:
    """The strip itself. Arrays have shape (CELLS,), cell j spans [j, j + 1] length / CELLS.

    `rigidity` EI [N m^2], `viscosity` [N m^2 s] (moment per rate of curvature),
    `rest_curvature` [1/m], `linear_density` [kg/m], all of the whole width.
    """

    length: float
    width: float
    thickness: float
    rigidity: Array
    viscosity: Array
    rest_curvature: Array
    linear_density: Array
    law: BendingLaw = BendingLaw()

    @property
    def touch_gap(self) -> float:
        """Vertical distance of midlines at which layers touch: max(thickness, 1 mm) [m]."""
        return max(self.thickness, 0.001)

    def total(self, values: Array, edges: Array) -> Array:
        """Integral of a per-cell field over the spans between `edges` (n + 1,) [m] -> (n,)."""
        cells = np.linspace(0.0, self.length, len(values) + 1)
        integral = np.concatenate([[0.0], np.cumsum(values) * (self.length / len(values))])
        return np.diff(np.interp(edges, cells, integral))

    def mean(self, values: Array, edges: Array) -> Array:
        """Mean of a per-cell field over the spans between `edges` (n + 1,) [m] -> (n,)."""
        return self.total(values, edges) / np.diff(edges)

    def series(self, values: Array, edges: Array) -> Array:
        """Harmonic mean over the spans between `edges`: stiffnesses in a row -> (n,)."""
        return 1.0 / self.mean(1.0 / values, edges)


@dataclass(frozen=True, slots=True)
class Boundary:
    """What holds and loads the strip: `gravity` (g_x, g_z) [m/s^2] in the cell frame."""

    gravity: tuple[float, float] = (0.0, -GRAVITY)


@dataclass(frozen=True, slots=True)
class Observation:
    """How the rig measures: `contact_height` [m], and what its stamps and scales get wrong."""

    contact_height: float = CONTACT_HEIGHT
    camera_latency: float = 0.0


@dataclass(frozen=True, slots=True)
class StripModel:
    """A strip in a cell. `stated_length` [m] is where the gripper takes the edge, x = L."""

    mechanics: Mechanics
    stated_length: float
    boundary: Boundary = field(default_factory=Boundary)
    observation: Observation = field(default_factory=Observation)
    index: int = 0


Effects = Mapping[str, Mapping[str, float]]


def describe(strip: StripFile, cell_effects: Effects | None = None, index: int = 0) -> StripModel:
    """The description of `strip` in a cell, with the effects of both applied in registry order.

    `index` counts the runs that this specimen has been through before.
    """
    from drivers.strip.effects import apply_effects

    rigidity = np.full(CELLS, strip.rigidity)
    mechanics = Mechanics(
        length=strip.length,
        width=strip.width,
        thickness=strip.thickness,
        rigidity=frozen(rigidity),
        viscosity=frozen(rigidity * strip.retardation_time),
        rest_curvature=frozen(np.zeros(CELLS)),
        linear_density=frozen(np.full(CELLS, strip.linear_density)),
    )
    bare = StripModel(mechanics=mechanics, stated_length=strip.length, index=index)
    return apply_effects(bare, {**strip.effects, **(cell_effects or {})})
