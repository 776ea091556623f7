"""The paper's simulation of a strip, for the benchmark of engines alone.

Spheres of 1 mm and 3.3 g every 2 mm on hinges with stiffness k and damping b, semi-implicit
Euler steps of 5 ms, Newton's method with at most 100 iterations, contacts with the desk only, the
free edge welded to the gripper with MuJoCo's default softness (paper, appendix).
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from drivers.errors import SimulationNotFinite
from drivers.strip.engine import Observables
from drivers.strip.model import StripModel
from drivers.strip.shape import Gap, Touch, desk_contact, fold_tip, layer_gap, touch_between
from drivers.types import Array

STEP = 0.005  # s
SPACING = 0.002  # m
RADIUS = 0.0005  # m
MASS = 0.0033  # kg
ITERATIONS = 100


class PaperFormulation:
    """Engine for one strip in the paper's formulation, with hinges every 2 mm."""

    def reset(self, models: Sequence[StripModel]) -> None:
        """Lay the one strip flat and still."""
        (self._strip,) = models
        strip = self._strip.mechanics
        self._links = round(strip.length / SPACING)
        stiffness, damping = strip.rigidity[0] / SPACING, strip.viscosity[0] / SPACING
        self._model = spec(self._links, stiffness, damping).compile()
        self._data = mujoco.MjData(self._model)
        self._gripper = self._model.body("gripper").mocapid[0]
        self._arc = np.linspace(0.0, strip.length, self._links + 1)
        self._time = 0.0
        self._gap: Gap | None = None
        self._touch: Touch | None = None

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance to gripper `poses` (1, 3) in 5 ms; raises ValueError for another `dt`."""
        if dt != STEP:
            raise ValueError("the paper steps by 5 ms")
        x, z, pitch = poses[0]
        self._data.mocap_pos[self._gripper] = x, 0.0, z
        self._data.mocap_quat[self._gripper] = np.cos(pitch / 2), 0.0, -np.sin(pitch / 2), 0.0
        mujoco.mj_step(self._model, self._data)
        self._time += dt
        points = self.shapes()[0]
        if not np.isfinite(points).all() or self._data.warning[_BAD].number:
            raise SimulationNotFinite("paper's formulation", self._time)
        self._look(points, dt)
        contact = desk_contact(points, self._strip.observation.contact_height)
        nothing = np.zeros(1)
        tip = np.array([fold_tip(points)])
        felt = np.zeros((1, 2))
        return Observables(self._time, np.array([contact]), tip, nothing, felt, (self._touch,))

    def shapes(self) -> Array:
        """The midline (1, nodes, 2) [m]."""
        return np.array(self._data.xpos[1 : self._links + 2][None][:, :, [0, 2]])

    def arc(self) -> Array:
        """Arc lengths (1, nodes) [m]."""
        return self._arc[None]

    def _look(self, points: Array, dt: float) -> None:
        before: tuple[float, Gap | None] = (self._time - dt, self._gap)
        strip = self._strip.mechanics
        self._gap = layer_gap(points, self._arc, 2 * strip.touch_gap)
        if self._touch is None:
            after = (self._time, self._gap)
            self._touch = touch_between(before, after, strip.touch_gap, strip.length)


_BAD = mujoco.mjtWarning.mjWARN_BADQACC


def spec(links: int, stiffness: float, damping: float) -> mujoco.MjSpec:
    """MuJoCo model of the strip: spheres on hinges along x, the first one fixed."""
    made = mujoco.MjSpec()
    made.compiler.degree = False
    made.option.timestep = STEP
    made.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    made.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    made.option.iterations = ITERATIONS
    made.option.disableflags = mujoco.mjtDisableBit.mjDSBL_AUTORESET
    plane = made.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1])
    plane.pos, plane.contype, plane.conaffinity = [0, 0, -RADIUS], 0, 1
    body = made.worldbody
    for node in range(links + 1):
        body = body.add_body(name=f"node{node}", pos=[SPACING if node else 0.0, 0, 0])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0, 0], mass=MASS,
                      contype=1, conaffinity=0)  # fmt: skip
        if node:
            body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0],
                           pos=[-SPACING, 0, 0], stiffness=[stiffness, 0, 0],
                           damping=[damping, 0, 0])  # fmt: skip
    made.worldbody.add_body(name="gripper", mocap=True, pos=[links * SPACING, 0, 0])
    made.add_equality(type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY,
                      name1="gripper", name2=f"node{links}")  # fmt: skip
    return made
