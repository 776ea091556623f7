"""MuJoCo model of a strip: a planar chain of hinges, with its layers, the desk, the
gripper and the joints.
"""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from drivers.base.geometry import left_normals
from drivers.base.types import Array
from drivers.strip.model import StripModel
from drivers.twin.chain.lumps import Lumps

HINGE, SLIDE = "hinge", "slide"  # names of joints, before the number of their node
LONGEST_STEP = 0.005  # s, the longest step of the chain
TIME_CONSTANT = 2 * LONGEST_STEP  # s, the shortest that MuJoCo allows
# of a violation's pull that a constraint exerts: sags by 1e-4 of a free fall
CONSTRAINT_SHARE = 0.9999
SOLREF = (TIME_CONSTANT, 1.0)
SOLIMP = np.array([CONSTRAINT_SHARE, CONSTRAINT_SHARE, 0.001, 0.5, 2.0])
GRIP_WEIGHT = 30.0  # 1/kg: a pull of 10 N stretches the grip by 7 um
TIP_MASS = 1e-3  # of a link's mass
DESK = 1  # collision class
# m, how far one layer may fall through the other and is still pushed back
THICK = 0.005
LAYER_FRICTION = 1.0  # of fabric on fabric, assumed; more than on a desk (paper, III-A)
UPPER = 2  # collision class
# cosine of the angle to the desk at which the bend between layers begins
FLAT = np.sqrt(0.5)
CLING_REACH = 0.0005  # m, how far layers that cling may part before they let go

Indices = NDArray[np.int_]


@dataclass(frozen=True, slots=True)
class Layers:
    """Layers of a fold: links up to number `lower`, and nodes from number `upper` on.

    The bend between the layers belongs to neither: it never touches itself.
    """

    lower: int
    upper: int

    @classmethod
    def from_angles(cls, angle: Array) -> Self:
        """Layers of a fold whose links are at `angle` (n,) [rad] from flat."""
        level = np.cos(angle)
        turned = np.argmax(level < 0)
        flat = np.flatnonzero(level[:turned] > FLAT)
        back = np.flatnonzero(level[turned:] < -FLAT)
        return cls(
            lower=int(flat[-1]) if len(flat) else 0,
            upper=int(turned + back[0]) if len(back) else len(angle),
        )

    def add(self, body: mujoco.MjsBody, node: int, lumps: Lumps, gap: float) -> None:
        """Add to `body` the contact shape of the link that begins at number `node`.

        It keeps midlines `gap` [m] apart. It lies on the outer side of the fold and is
        thick, because a falling layer moves by more than the thickness of fabric within
        a step.
        """
        link = min(node, len(lumps.spans) - 1)
        radius = max(THICK, gap)
        outside = 0.5 * gap - radius
        if node >= self.upper:
            bead = _solid(body, contype=UPPER, conaffinity=0)
            bead.size = [radius, 0.0, 0.0]
            bead.pos = [0.0, 0.0, outside]
        elif node <= self.lower:
            bead = _solid(body, contype=0, conaffinity=UPPER)
            bead.type = mujoco.mjtGeom.mjGEOM_CAPSULE
            bead.size = [radius, 0.0, 0.0]
            bead.fromto = [0.0, 0.0, outside, lumps.spans[link], 0.0, outside]
        else:
            return

        if lumps.cling[link] > 0:
            bead.adhesion = lumps.cling[link]
            bead.gap = CLING_REACH

        bead.condim = 3
        bead.friction = [LAYER_FRICTION, 0.0, 0.0]


def build(model: StripModel, links: int, layers: Layers | None = None) -> mujoco.MjSpec:
    """Build a MuJoCo spec of `model` as a chain of `links` links, flat along +x, held
    at its end.

    Body i + 1 has its origin at node i; the last one is the tip, welded to the gripper.
    Without `layers` only the desk carries the strip, with them its layers rest on each
    other.
    """
    lumps = Lumps.from_model(model, links)
    gap = model.mechanics.touch_gap
    spec = mujoco.MjSpec()
    _set_options(spec, model.boundary.gravity)
    _add_desk(spec, gap / 2 - sag(-model.boundary.gravity[1]))
    body = spec.worldbody

    for node in range(links + 1):
        offset = [lumps.spans[node - 1] if node > 0 else 0.0, 0.0, 0.0]
        body = body.add_body(name=f"node{node}", pos=offset)
        _add_slide(body, model, lumps, node)
        _add_hinge(spec, body, lumps, node)
        _add_mass(body, lumps, node)
        if node > 0:
            _solid(body, contype=DESK, conaffinity=0).size = [gap / 2, 0.0, 0.0]
        if layers is not None:
            layers.add(body, node, lumps, gap)

    _add_grip(spec, links, model.mechanics.length)
    spec.body("node0").add_site(name="fixed_edge")
    spec.add_sensor(  # of the force with which the fixed edge is held
        name="holding",
        type=mujoco.mjtSensor.mjSENS_FORCE,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname="fixed_edge",
    )
    return spec


def compile_chain(
    model: StripModel, links: int, layers: Layers | None = None
) -> mujoco.MjModel:
    """Compile the MuJoCo model of a strip's chain, with the stiffness of its hold in
    the gripper corrected.

    MuJoCo softens a weld in proportion to how light the welded body is. The tip is
    nearly massless, so with the default its grip would sag by millimetres, and more
    with more links.
    """
    chain = build(model, links, layers).compile()
    turn = 1.0 / (LONGEST_STEP**2 * chain.jnt_stiffness[-1])
    chain.body_invweight0[links + 1] = GRIP_WEIGHT, turn
    return chain


def _set_options(spec: mujoco.MjSpec, gravity: tuple[float, float]) -> None:
    """Set integrator, solver and step, and `gravity` (g_x, g_z) [m/s^2]."""
    option = spec.option
    off = mujoco.mjtDisableBit
    spec.compiler.degree = False
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.timestep = LONGEST_STEP
    option.gravity = [gravity[0], 0.0, gravity[1]]
    option.disableflags = off.mjDSBL_AUTORESET | off.mjDSBL_ISLAND


def _add_desk(spec: mujoco.MjSpec, depth: float) -> None:
    """Add the desk, a plane `depth` [m] below z = 0, which only the strip touches."""
    spec.worldbody.add_geom(
        name="desk",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0.0, 0.0, -depth],
        size=[2.0, 2.0, 0.1],
        contype=0,
        conaffinity=DESK,
        condim=1,
    )


def _add_slide(
    body: mujoco.MjsBody, model: StripModel, lumps: Lumps, node: int
) -> None:
    """Let the body at `node` move along the link before it, or at node 0 along the
    desk.
    """
    if node == 0:
        moves = np.isfinite(model.boundary.edge_friction)
        stiffness = lumps.stiffest[0]
    else:
        slips = node == len(lumps.mass) and np.isfinite(model.boundary.grip_force)
        moves = lumps.stretches or slips
        stiffness = lumps.along[node - 1]
    if moves:
        body.add_joint(
            name=f"{SLIDE}{node}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[1.0, 0.0, 0.0],
            stiffness=[stiffness, 0.0, 0.0],
        )


def _add_hinge(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, lumps: Lumps, node: int
) -> None:
    """Add hinge number `node` to `body` with its bending stiffness, and a tendon for
    the friction of the yarns.
    """
    hinges = lumps.hinges
    name = f"{HINGE}{node}"
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, -1.0, 0.0],
        stiffness=[hinges.stiffness[node], 0.0, hinges.cubic[node]],
        damping=[
            hinges.damping_at(LONGEST_STEP)[node],
            hinges.quadratic[node],
            0.0,
        ],
        springref=hinges.rest_angle[node],
    )
    if hinges.slip[node] > 0 and hinges.presliding[node] > 0:
        # A joint has one spring; a tendon is the other, with friction.
        yarns = spec.add_tendon(
            name=f"yarns{node}",
            stiffness=[hinges.presliding[node], 0.0, 0.0],
            springyield=hinges.slip[node],
            springlength=[0.0, 0.0],
        )
        yarns.wrap_joint(name, 1.0)


def _add_mass(body: mujoco.MjsBody, lumps: Lumps, node: int) -> None:
    """Set mass and inertia of the link that begins at `node`, or of the tip at the last
    node.
    """
    if node < len(lumps.mass):
        mass = lumps.mass[node]
        centre = 0.5 * lumps.spans[node]
        inertia = mass * lumps.spans[node] ** 2 / 12
    else:
        mass = TIP_MASS * lumps.mass[-1]
        centre = 0.0
        inertia = LONGEST_STEP**2 * lumps.hinges.stiffness[-1]

    body.explicitinertial = True
    body.mass = mass
    body.ipos = [centre, 0.0, 0.0]
    body.inertia = [inertia, inertia, inertia]


def _add_grip(spec: mujoco.MjSpec, links: int, length: float) -> None:
    """Add the gripper, and the weld by which it holds the last node."""
    spec.worldbody.add_body(name="gripper", mocap=True, pos=[length, 0.0, 0.0])
    grip = spec.add_equality(
        name="grip",
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1="gripper",
        name2=f"node{links}",
        solref=SOLREF,
        solimp=SOLIMP,
    )
    grip.data = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0]  # same place, same orientation


def sag(acceleration: float) -> float:
    """Depth [m] to which a body at rest under `acceleration` [m/s^2] sinks into a
    contact.

    Over it a strip starts at rest. Over a desk without it the strip would fall freely
    for a step, to a kink of 0.1 mm at its fixed edge, and under the push of a lift the
    strip would buckle there instead of at the grip.
    """
    return (1.0 - CONSTRAINT_SHARE) * acceleration * TIME_CONSTANT**2


def _solid(body: mujoco.MjsBody, contype: int, conaffinity: int) -> mujoco.MjsGeom:
    """Add to `body` a massless, frictionless sphere whose stiffness determines its
    contacts.
    """
    return body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        contype=contype,
        conaffinity=conaffinity,
        condim=1,
        priority=1,
        solref=SOLREF,
        solimp=SOLIMP,
        mass=0.0,
    )


@dataclass(frozen=True, slots=True)
class Joints:
    """Indices of the joints of a chain of n links, whose lengths at rest are `spans`
    (n,) [m].

    `hinges` (n + 1,) are those of the nodes; `slides` those by which the links
    `lengthened` grow longer; `edge` moves the fixed edge along the desk, `grip` the end
    of the last link.
    """

    spans: Array
    hinges: Indices
    slides: Indices
    lengthened: Indices
    edge: int | None
    grip: int | None

    @classmethod
    def from_model(cls, model: mujoco.MjModel, spans: Array) -> Self:
        """Joint indices of a compiled chain whose links are `spans` (n,) [m] long."""
        links = len(spans)
        numbers = {model.joint(j).name: j for j in range(model.njnt)}
        slides = {
            k: numbers[f"{SLIDE}{k}"]
            for k in range(links + 1)
            if f"{SLIDE}{k}" in numbers
        }
        stretching = [node for node in slides if node > 0]
        return cls(
            spans=spans,
            hinges=np.array([numbers[f"{HINGE}{k}"] for k in range(links + 1)]),
            slides=np.array([slides[node] for node in stretching], dtype=int),
            lengthened=np.array(stretching, dtype=int) - 1,
            edge=slides.get(0),
            grip=slides.get(links),
        )

    def angles(self, position: Array) -> Array:
        """Angles (n + 1,) [rad] from flat of the chain's n links and tip, at joint
        `position` (MuJoCo's qpos).
        """
        return position[self.hinges].cumsum()

    def nodes(self, position: Array) -> Array:
        """Positions x, z (n + 1, 2) [m] of the chain's nodes at joint `position`
        (MuJoCo's qpos).
        """
        angles = self.angles(position)[:-1]
        nodes = np.zeros((len(self.hinges), 2))
        nodes[1:, 0] = np.cos(angles)
        nodes[1:, 1] = np.sin(angles)
        nodes[1:] *= self._lengths(position)
        if self.edge is not None:
            nodes[0, 0] = position[self.edge]
        return nodes.cumsum(axis=0)

    def speeds(self, position: Array, rate: Array) -> tuple[Array, Array]:
        """Speeds (n, 2) [m/s] of the links' middles along and across the links, and the
        links' unit directions (n, 2).
        """
        angles = self.angles(position)[:-1]
        along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        normals = left_normals(along)

        # velocity of each link's end from its beginning, by its turn and by its stretch
        turning = rate[self.hinges].cumsum()[:-1, None]
        turn = turning * self._lengths(position) * normals
        stretch = np.zeros((len(angles), 1))
        stretch[self.lengthened, 0] = rate[self.slides]

        ends = (turn + stretch * along).cumsum(axis=0)
        middles = ends - 0.5 * turn
        if self.edge is not None:
            middles[:, 0] += rate[self.edge]
        speed_along = (middles * along).sum(axis=1)
        speed_across = (middles * normals).sum(axis=1)
        return np.stack([speed_along, speed_across], axis=1), along

    def _lengths(self, position: Array) -> Array:
        lengths = self.spans[:, None].copy()
        lengths[self.lengthened, 0] += position[self.slides]
        return lengths
