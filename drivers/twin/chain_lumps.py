"""The fields of a strip lumped onto the links and hinges of a chain."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from drivers.strip.file import PAPER_LINEAR_DENSITY
from drivers.strip.model import Drag, Mechanics, StripModel
from drivers.types import Array

AIR = 1.2  # kg/m^3
RIGID = 3e3  # axial stiffness over weight from which a strip counts as inextensible


@dataclass(frozen=True, slots=True)
class Lumps:
    """A strip on n links and n + 1 hinges, in the chain's own unit of mass.

    Dynamics do not change when masses, stiffnesses and forces share a factor; solver tolerances
    do. So every strip is built as heavy as the paper's: `scale` is that factor.

    Of the links, all (n,): `mass` [kg] and `drag` [N s^2/m^2], force over the square of the normal
    speed; `air` says what other speeds count. Of the hinges, all (n + 1,): `stiffness` [N
    m/rad], `damping` [N m s/rad], `quadratic` [N m s^2/rad^2], `rest` [rad], `cubic` [N
    m/rad^3], `fifth` [N m/rad^5]; of the element of friction beside them `presliding` [N m/rad]
    and `slip` [rad], its deflection when it begins to slide; `fading` [N m/rad], what of the
    stiffness relaxes within `fading_time` [s]. A hinge stands for the strip between the middles
    of its two links; the first and the last one for half a link, so that both clamps are of
    second order in the spacing.
    `cling` [N] holds a link to another one that it touches.
    `along` [N/m] is the stiffness of a link along itself, `held` the largest that a chain steps.
    """

    spacing: float
    scale: float
    mass: Array
    drag: Array
    air: Drag
    stiffness: Array
    damping: Array
    quadratic: Array
    rest: Array
    cubic: Array
    fifth: Array
    presliding: Array
    slip: Array
    fading: Array
    fading_time: float
    cling: float
    along: float
    held: float

    @classmethod
    def of(cls, model: StripModel, links: int) -> Self:
        """The lumped fields of `model` on `links` links."""
        strip, law = model.mechanics, model.mechanics.law
        nodes = np.linspace(0.0, strip.length, links + 1)
        middles = np.concatenate([[0.0], 0.5 * (nodes[:-1] + nodes[1:]), [strip.length]])
        span, spacing = np.diff(middles), strip.length / links
        mass = strip.total(strip.linear_density, nodes)
        scale = PAPER_LINEAR_DENSITY * strip.length / float(mass.sum())
        bare = strip.series(strip.rigidity, middles) / span
        share = _share_of_strip(bare, model.boundary.grip_compliance)
        stiffness = bare * share * scale
        spring, growth = stiffness * (1.0 - law.relaxing), law.cubic * share**3 / span**2
        weight = float(mass.sum()) * float(np.hypot(*model.boundary.gravity))
        return cls(
            spacing=spacing,
            scale=scale,
            mass=mass * scale,
            drag=np.full(links, _drag(strip) * spacing * scale),
            air=strip.drag,
            stiffness=stiffness,
            damping=stiffness * share * bare * strip.total(_lag(strip), middles),
            quadratic=stiffness * law.quadratic_damping / span,
            rest=strip.total(strip.rest_curvature, middles),
            cubic=spring * growth,
            fifth=spring * law.fifth * growth**2,
            presliding=stiffness * law.stiffness_ratio,
            slip=span * (law.yield_curvature / law.stiffness_ratio) / share,
            fading=stiffness * law.relaxing,
            fading_time=law.relaxation_time,
            cling=strip.adhesion * spacing * scale,
            along=min(RIGID * weight, strip.stretch_stiffness) * scale / spacing,
            held=RIGID * weight * scale / spacing,
        )

    @property
    def stretches(self) -> bool:
        """Whether the strip gives way along itself by more than a chain can tell from rigid."""
        return self.along < self.held

    def damping_at(self, h: float) -> Array:
        """Damping (n + 1,) [N m s/rad] to simulate with steps of `h` [s].

        An implicit step takes the spring's moment at its end, which damps like h times the
        stiffness; what is left to add is the rest. This makes d of second order in the step.
        """
        return np.maximum(self.damping - h * self.stiffness, 0.0)


def _lag(strip: Mechanics) -> Array:
    """Damping of unlike pieces under one moment: D = K^2 int(viscosity / EI^2) ds."""
    return strip.viscosity / strip.rigidity**2


def _drag(strip: Mechanics) -> float:
    """Force per length over the square of the normal speed [N s^2/m^3]."""
    return 0.5 * AIR * strip.drag.coefficient * strip.width


def _share_of_strip(stiffness: Array, compliance: float) -> Array:
    """Share s (n + 1,) of the strip in each hinge's angle: at the last one the grip yields too.

    Under one moment angles add up: K' = s K with s = 1 / (1 + C K); then the strip's damping
    counts s^2, the cubic term against K' s^3.
    """
    share = np.ones_like(stiffness)
    share[-1] = 1.0 / (1.0 + compliance * stiffness[-1])
    return share
