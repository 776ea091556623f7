"""Lumping of a strip model onto the links and hinges of a chain."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from drivers.base.types import Array
from drivers.strip.engine import graded_nodes
from drivers.strip.file import PAPER_LINEAR_DENSITY
from drivers.strip.model import Drag, StripModel

GRADED = 0.05  # share of the links that grow shorter towards the grip
SHORTEST_LINK = 1 / 4  # length of the last of them over that of an equal one
RIGID = 3e3  # axial stiffness over weight from which a strip counts as inextensible


@dataclass(frozen=True, slots=True)
class HingeLumps:
    """Bending coefficients of a strip at the n + 1 hinges of a chain, each an array (n
    + 1,).

    A hinge stands for `reach` [m] of the strip, between the middles of its two links;
    the first and the last one for half a link, so that both clamps are of second order
    in the links' lengths.

    `stiffness` [N m/rad], `damping` [N m s/rad], `quadratic` [N m s^2/rad^2],
    `rest_angle` [rad], `cubic` [N m/rad^3], `fifth` [N m/rad^5]; of the element of
    friction beside them `presliding` [N m/rad] and `slip` [rad], its deflection when it
    begins to slide; of friction without a yield point `gradual` [N m/rad], its
    stiffness, and `gradual_limit` [N m], its moment in full sliding; `fading` [N
    m/rad], what of the stiffness relaxes within `fading_time` [s].
    """

    reach: Array
    stiffness: Array
    damping: Array
    quadratic: Array
    rest_angle: Array
    cubic: Array
    fifth: Array
    presliding: Array
    slip: Array
    gradual: Array
    gradual_limit: Array
    fading: Array
    fading_time: float

    @classmethod
    def from_model(cls, model: StripModel, nodes: Array, scale: float) -> Self:
        """Bending coefficients of `model`, multiplied by `scale`, for hinges at arc
        lengths `nodes` (n + 1,) [m].

        The powers of `share` are those that `_strip_share` states.
        """
        strip = model.mechanics
        law = model.mechanics.law
        between = 0.5 * (nodes[:-1] + nodes[1:])
        middles = np.concatenate([[0.0], between, [strip.length]])
        reach = np.diff(middles)

        # without the grip's compliance
        bare = strip.series(strip.rigidity, middles) / reach
        share = _strip_share(bare, model.boundary.grip_compliance)
        stiffness = bare * share * scale
        elastic = stiffness * (1.0 - law.relaxing)
        cubic_growth = law.cubic * share**3 / reach**2

        stuck_stiffness = bare * (1.0 + law.stiffness_ratio)
        stuck_share = _strip_share(stuck_stiffness, model.boundary.grip_compliance)
        presliding = stiffness * law.stiffness_ratio * stuck_share
        slip = reach * (law.yield_curvature / law.stiffness_ratio) / stuck_share

        # unlike pieces under one moment: damping = K^2 int(viscosity / EI^2) ds
        creep = strip.total(strip.viscosity / strip.rigidity**2, middles)
        return cls(
            reach=reach,
            stiffness=stiffness,
            damping=stiffness * share * bare * creep,
            quadratic=stiffness * share**2 * law.quadratic_damping / reach,
            rest_angle=strip.total(strip.rest_curvature, middles),
            cubic=elastic * cubic_growth,
            fifth=elastic * law.fifth * cubic_growth**2,
            presliding=(1.0 - law.gradual) * presliding,
            slip=slip,
            gradual=law.gradual * presliding,
            gradual_limit=law.gradual * presliding * slip,
            fading=stiffness * law.relaxing,
            fading_time=law.relaxation_time,
        )

    def damping_at(self, h: float) -> Array:
        """Damping (n + 1,) [N m s/rad] of the hinges to simulate with steps of `h` [s].

        An implicit step takes the spring's moment at its end, which damps like h times
        the stiffness; the difference is what has to be added. This makes the
        displacement second-order accurate in the step.
        """
        return np.maximum(self.damping - h * self.stiffness, 0.0)


def _strip_share(stiffness: Array, grip_compliance: float) -> Array:
    """Fraction (n + 1,) of each hinge's angle that the strip itself bends; below 1 only
    where a compliant gripper bends with it.

    Under one moment angles add up, so that a hinge of `stiffness` K [N m/rad] in series
    with the compliance C [rad/(N m)] has s K with s = 1 / (1 + C K); then the strip's
    damping counts s^2, quadratic damping s^3, the cubic term against s K s^3, friction
    s; s is smaller while it sticks.
    """
    share = np.ones_like(stiffness)
    share[-1] = 1.0 / (1.0 + grip_compliance * stiffness[-1])
    return share


@dataclass(frozen=True, slots=True)
class Lumps:
    """Coefficients of a strip on the n links and the `hinges` of a chain, in a scaled
    unit of mass.

    Dynamics do not change when masses, stiffnesses and forces share a factor; solver
    tolerances do. So every strip is built as heavy as the paper's: `scale` is that
    factor.

    Of the links, all (n,): length `spans` [m], `mass` [kg] and `drag` [N s^2/m^2],
    force over the square of the normal speed; `air` says what other speeds count.
    `cling` [N] holds a link to another that it touches, `along` [N/m] is its stiffness
    along itself, `stiffest` the largest that a chain steps.
    """

    hinges: HingeLumps
    scale: float
    spans: Array
    mass: Array
    drag: Array
    air: Drag
    cling: Array
    along: Array
    stiffest: Array

    @classmethod
    def from_model(cls, model: StripModel, links: int) -> Self:
        """Coefficients of the strip `model` on a chain of `links` links."""
        strip = model.mechanics
        nodes = chain_nodes(strip.length, links)
        spans = np.diff(nodes)
        mass = strip.total(strip.linear_density, nodes)
        total = float(mass.sum())
        scale = PAPER_LINEAR_DENSITY * strip.length / total
        weight = total * np.hypot(*model.boundary.gravity)
        return cls(
            hinges=HingeLumps.from_model(model, nodes, scale),
            scale=scale,
            spans=spans,
            mass=mass * scale,
            drag=strip.drag_per_length * spans * scale,
            air=strip.drag,
            cling=strip.adhesion * spans * scale,
            along=min(RIGID * weight, strip.stretch_stiffness) * scale / spans,
            stiffest=RIGID * weight * scale / spans,
        )

    @property
    def stretches(self) -> bool:
        """Whether the strip is so soft lengthwise that its chain simulates
        stretching.
        """
        return bool((self.along < self.stiffest).any())


def chain_nodes(length: float, links: int) -> Array:
    """Arc lengths (links + 1,) [m] of the nodes of a chain of `links` links, shorter
    ones near the gripper.

    For a blanket that slips in its grip, 200 equal links put the desk contact of a taut
    lift 29 mm from the rod's; these put it 9 mm away.
    """
    return graded_nodes(length, links, GRADED, SHORTEST_LINK)
