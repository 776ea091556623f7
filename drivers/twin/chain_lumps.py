"""The fields of a strip lumped onto the links and hinges of a chain."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from drivers.strip.file import PAPER_LINEAR_DENSITY
from drivers.strip.model import StripModel
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Lumps:
    """A strip on n links and n + 1 hinges, in the chain's own unit of mass.

    Dynamics do not change when masses, stiffnesses and forces share a factor; solver tolerances
    do. So every strip is built as heavy as the paper's: `scale` is that factor.

    `mass` (n,) [kg] of the links. Of the hinges, all (n + 1,): `stiffness` [N m/rad], `damping`
    [N m s/rad], `rest` [rad], `cubic` [N m/rad^3], and of the element of friction beside them
    `presliding` [N m/rad] and `slip` [rad], its deflection when it begins to slide. A hinge
    stands for the strip between the middles of its two links; the first and the last one for
    half a link, so that both clamps are of second order in the spacing.
    """

    spacing: float
    scale: float
    mass: Array
    stiffness: Array
    damping: Array
    rest: Array
    cubic: Array
    presliding: Array
    slip: Array

    @classmethod
    def of(cls, model: StripModel, links: int) -> Self:
        """The lumped fields of `model` on `links` links."""
        strip, law = model.mechanics, model.mechanics.law
        nodes = np.linspace(0.0, strip.length, links + 1)
        middles = np.concatenate([[0.0], 0.5 * (nodes[:-1] + nodes[1:]), [strip.length]])
        span = np.diff(middles)
        mass = strip.total(strip.linear_density, nodes)
        scale = PAPER_LINEAR_DENSITY * strip.length / float(mass.sum())
        bare = strip.series(strip.rigidity, middles) / span
        stiffness = bare * scale
        return cls(
            spacing=strip.length / links,
            scale=scale,
            mass=mass * scale,
            stiffness=stiffness,
            damping=stiffness * bare * strip.total(strip.viscosity / strip.rigidity**2, middles),
            rest=strip.total(strip.rest_curvature, middles),
            cubic=stiffness * law.cubic / span**2,
            presliding=stiffness * law.stiffness_ratio,
            slip=span * (law.yield_curvature / law.stiffness_ratio),
        )

    def damping_at(self, h: float) -> Array:
        """Damping (n + 1,) [N m s/rad] to simulate with steps of `h` [s].

        An implicit step takes the spring's moment at its end, which damps like h times the
        stiffness; what is left to add is the rest. This makes d of second order in the step.
        """
        return np.maximum(self.damping - h * self.stiffness, 0.0)
