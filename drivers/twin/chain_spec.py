"""The MuJoCo description of a strip: a planar chain of hinges, desk and gripper."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from drivers.errors import Unsupported
from drivers.strip.file import PAPER_LINEAR_DENSITY
from drivers.strip.model import StripModel
from drivers.types import Array

STEP = 0.005  # s, the longest step of the chain
GRIP_SOLREF = (2 * STEP, 1.0)  # time constant [s] and damping ratio, the stiffest allowed
STIFF = np.array([0.9999, 0.9999, 0.001, 0.5, 2.0])  # solimp: sags by 1e-4 of a free fall
GRIP_WEIGHT = 300.0  # 1/kg: a pull of 10 N stretches the grip by 0.07 mm
TIP_MASS = 1e-3  # of a link's mass
LAYER_RADIUS = 0.01  # m, thickness of the bodies that keep the layers apart
LAYER_FRICTION = 0.5  # between the layers once they have touched
UPPER, LOWER, DESK = 1, 2, 4  # collision classes


@dataclass(frozen=True, slots=True)
class Lumps:
    """A strip lumped on n links and n + 1 hinges, in the chain's own unit of mass.

    Dynamics do not change when masses, stiffnesses and forces share a factor; solver tolerances
    do. So every strip is built as heavy as the paper's, and `scale` is that factor.

    `mass` (n,) [kg] of the links, `stiffness` [N m/rad], `damping` [N m s/rad], `rest` [rad],
    `cubic` [N m/rad^3], `friction` [N m] and `presliding` [N m/rad], all (n + 1,), of the
    hinges. A hinge stands for the strip between the middles of its neighbours; the first and
    the last one for half a link, so that both clamps are of second order in the spacing.
    """

    spacing: float
    scale: float
    mass: Array
    stiffness: Array
    damping: Array
    rest: Array
    cubic: Array
    friction: Array
    presliding: Array

    @classmethod
    def of(cls, model: StripModel, links: int) -> Self:
        """The lumped fields of `model` on `links` links."""
        strip, law = model.mechanics, model.mechanics.law
        nodes = np.linspace(0.0, strip.length, links + 1)
        middles = np.concatenate([[0.0], 0.5 * (nodes[:-1] + nodes[1:]), [strip.length]])
        span = np.diff(middles)
        mass = strip.total(strip.linear_density, nodes)
        scale = PAPER_LINEAR_DENSITY * strip.length / float(mass.sum())
        rigidity = strip.series(strip.rigidity, middles) * scale
        stiffness = rigidity / span
        return cls(
            spacing=strip.length / links,
            scale=scale,
            mass=mass * scale,
            stiffness=stiffness,
            damping=stiffness * strip.mean(strip.viscosity / strip.rigidity, middles),
            rest=strip.total(strip.rest_curvature, middles),
            cubic=stiffness * law.cubic / span**2,
            friction=rigidity * law.yield_curvature,
            presliding=stiffness * law.stiffness_ratio,
        )


def build(model: StripModel, links: int, fold: int | None = None) -> mujoco.MjSpec:
    """A fresh spec of `model` on `links` links, flat along +x, gripped at its end.

    Body i + 1 has its origin at node i; the last one is the tip, welded to the gripper.
    With `fold`, the node at the fold's rightmost point, the layers on its two sides rest on
    each other; without it only the desk carries the strip.
    Raises Unsupported for a strip that is not as long as stated.
    """
    if abs(model.mechanics.length - model.stated_length) > 1e-9:
        raise Unsupported("chain", "a strip that is not as long as stated")
    lumps = Lumps.of(model, links)
    spec = mujoco.MjSpec()
    _set_options(spec, model)
    radius = model.mechanics.touch_gap / 2
    _add_desk(spec, radius)
    body = spec.worldbody
    for node in range(links + 1):
        place = [0.0, 0.0, 0.0] if node == 0 else [lumps.spacing, 0.0, 0.0]
        body = body.add_body(name=f"node{node}", pos=place)
        _add_hinge(spec, body, lumps, node)
        _add_mass(body, lumps, node)
        if node > 0:
            _add_bead(body, radius)
        if fold is not None:
            _add_layer(body, lumps.spacing, node - fold, radius)
    _add_grip(spec, links, model.stated_length)
    _add_force_sensor(spec)
    return spec


def compiled(model: StripModel, links: int, fold: int | None = None) -> mujoco.MjModel:
    """The compiled chain, its grip as stiff as the strip needs.

    MuJoCo softens a weld in proportion to how light the welded body is. The tip is nearly
    massless, so left alone its grip would sag by centimetres, and more with more links.
    """
    chain = build(model, links, fold).compile()
    tip = chain.body(f"node{links}").id
    turn = 1.0 / (STEP**2 * float(chain.jnt_stiffness[-1]))
    chain.body_invweight0[tip] = GRIP_WEIGHT, turn
    return chain


def _set_options(spec: mujoco.MjSpec, model: StripModel) -> None:
    option = spec.option
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.timestep = STEP
    option.disableflags = mujoco.mjtDisableBit.mjDSBL_AUTORESET
    gx, gz = model.boundary.gravity
    option.gravity = [gx, 0.0, gz]
    spec.compiler.degree = False


def _add_desk(spec: mujoco.MjSpec, radius: float) -> None:
    spec.worldbody.add_geom(
        name="desk",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0.0, 0.0, -radius],
        size=[2.0, 2.0, 0.1],
        contype=0,
        conaffinity=DESK,
        condim=1,
    )


def _add_hinge(spec: mujoco.MjSpec, body: mujoco.MjsBody, lumps: Lumps, node: int) -> None:
    name = f"hinge{node}"
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, -1.0, 0.0],
        stiffness=[lumps.stiffness[node], 0.0, lumps.cubic[node]],
        damping=[lumps.damping[node], 0.0, 0.0],
        springref=lumps.rest[node],
    )
    if lumps.friction[node] > 0:
        tendon = spec.add_tendon(
            name=f"yarns{node}",
            stiffness=[lumps.presliding[node], 0.0, 0.0],
            springyield=lumps.friction[node],
            springlength=[0.0, 0.0],
        )
        tendon.wrap_joint(name, 1.0)


def _add_mass(body: mujoco.MjsBody, lumps: Lumps, node: int) -> None:
    body.explicitinertial = True
    if node < len(lumps.mass):
        body.mass = lumps.mass[node]
        body.ipos = [0.5 * lumps.spacing, 0.0, 0.0]
        about_centre = lumps.mass[node] * lumps.spacing**2 / 12
    else:
        body.mass = TIP_MASS * lumps.mass[-1]
        body.ipos = [0.0, 0.0, 0.0]
        about_centre = STEP**2 * lumps.stiffness[-1]
    body.inertia = [about_centre, about_centre, about_centre]


def _add_bead(body: mujoco.MjsBody, radius: float) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[radius, 0.0, 0.0],
        contype=DESK,
        conaffinity=0,
        condim=1,
        solref=GRIP_SOLREF,
        solimp=STIFF,
        mass=0.0,
    )


def _add_layer(body: mujoco.MjsBody, spacing: float, beyond: int, radius: float) -> None:
    """What keeps the layers apart lies on the outer side of the fold, and is thick: a layer
    that has fallen through the other by millimetres within a step is still pushed back."""
    outwards = [0.0, 0.0, radius - LAYER_RADIUS]
    if beyond >= 2:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[LAYER_RADIUS, 0.0, 0.0],
            pos=outwards,
            contype=UPPER,
            conaffinity=0,
            condim=3,
            friction=[LAYER_FRICTION, 0.0, 0.0],
            solref=GRIP_SOLREF,
            solimp=STIFF,
            mass=0.0,
        )
    elif beyond <= -3:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[LAYER_RADIUS, 0.0, 0.0],
            fromto=[0.0, 0.0, outwards[2], spacing, 0.0, outwards[2]],
            contype=0,
            conaffinity=UPPER,
            condim=3,
            friction=[LAYER_FRICTION, 0.0, 0.0],
            solref=GRIP_SOLREF,
            solimp=STIFF,
            mass=0.0,
        )


def _add_grip(spec: mujoco.MjSpec, links: int, length: float) -> None:
    spec.worldbody.add_body(name="gripper", mocap=True, pos=[length, 0.0, 0.0])
    grip = spec.add_equality(
        name="grip",
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1="gripper",
        name2=f"node{links}",
        solref=GRIP_SOLREF,
        solimp=STIFF,
    )
    grip.data = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0]  # same place, same orientation


def _add_force_sensor(spec: mujoco.MjSpec) -> None:
    spec.body("node0").add_site(name="fixed_edge")
    spec.add_sensor(
        name="holding",
        type=mujoco.mjtSensor.mjSENS_FORCE,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname="fixed_edge",
    )
