"""Engine of the twin: MuJoCo simulates strips as planar chains of hinged links, one end
welded to the gripper, and ends that may slide with friction.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from drivers.base.errors import SimulationNotFinite
from drivers.base.geometry import running_sums
from drivers.base.types import Array
from drivers.strip.engine import Observables, Touch
from drivers.strip.model import StripModel
from drivers.strip.shape import NO_GAP, desk_contact, fold_tip, layer_gap, layer_touch
from drivers.twin.chain.forces import ExtraForce, ExtraForces, Loads, Parts, strip_laws
from drivers.twin.chain.lumps import Lumps
from drivers.twin.chain.spec import (
    CONSTRAINT_SHARE,
    LONGEST_STEP,
    TIME_CONSTANT,
    Joints,
    Layers,
    compile_chain,
)

HOLD_DAMPING = 2 / (CONSTRAINT_SHARE * TIME_CONSTANT)  # 1/s
HOLD_STIFFNESS = 1 / (CONSTRAINT_SHARE * TIME_CONSTANT**2)  # 1/s^2
# until the edge is there, and until the strip lies still
APPROACH_STEPS, SETTLING_STEPS = 120, 280
# of the arc on which the edge is brought in, over what a slack strip allows
APPROACH_HEIGHT = 0.7
VELOCITY_DECAY = 0.9  # of the velocities that are left after a step, meanwhile
NOT_SLIDING = 0.0
GIVE = 1e-4  # m, by which an end yields before it slides


@dataclass(frozen=True, slots=True)
class CommandedGrip:
    """Commanded gripper `pose` (3,) of x, z [m] and pitch [rad], and its `rate` (3,) of
    change per second.
    """

    pose: Array
    rate: Array

    @classmethod
    def at_rest(cls, pose: Array) -> Self:
        """Gripper commanded to rest at `pose` (3,) [m, m, rad]."""
        return cls(pose, np.zeros(3))

    def to(self, pose: Array, h: float) -> Self:
        """Gripper commanded to `pose` (3,) [m, m, rad], at the rate that brings it
        there from the present pose within `h` [s].
        """
        return type(self)(pose, (pose - self.pose) / h)

    def target(self, before: Self, h: float) -> Array:
        """Weld target (3,) [m, m, rad] that puts the chain's held end at the commanded
        pose after a step of `h` [s].

        The weld obeys a + b v + k r = 0, with acceleration a, rate v and violation r
        (tip minus target) at the step's end; a tip on its commanded motion has r = -(a
        + b v) / k.
        """
        acceleration = (self.rate - before.rate) / h
        return self.pose + (acceleration + HOLD_DAMPING * self.rate) / HOLD_STIFFNESS


def approach_poses(model: StripModel) -> Array:
    """Gripper poses (k, 3) [m, m, rad] that bring a lying free edge to the stated
    length.

    A strip that is too long is brought there in an arc, which leaves its slack as a
    wave; one that is too short is pulled taut. Empty for a strip of exactly the stated
    length.
    """
    mechanics = model.mechanics
    slack = mechanics.length - model.stated_length
    if slack == 0:
        return np.empty((0, 3))
    share = np.concatenate(
        [np.linspace(0.0, 1.0, APPROACH_STEPS + 1)[1:], np.ones(SETTLING_STEPS)]
    )
    reach = np.sqrt(2 * mechanics.length * max(slack, 0.0))
    height = APPROACH_HEIGHT * reach * np.sqrt(share * (1 - share))
    return np.stack(
        [mechanics.length - slack * share, height, np.zeros_like(share)], axis=1
    )


@dataclass(slots=True)
class Slide:
    """Stick-slip element: a stiff spring up to the force `limit`, then a constant
    force.

    It sticks again when the motion reverses. `joint` is the coordinate, `stiffness`
    that of the spring, all in the chain's scaled units; `anchor` is the spring's rest
    position and `sliding` the sign of the motion.
    """

    joint: int
    stiffness: float
    limit: float
    both_ways: bool
    anchor: float = 0.0
    sliding: float = NOT_SLIDING

    @classmethod
    def sticking(
        cls, joint: int | None, limit: float, stiffest: float, *, both_ways: bool
    ) -> Self | None:
        """Stick-slip element at rest that gives way by at most GIVE before it slides;
        None if it never slides.
        """
        if joint is None or np.isinf(limit):
            return None
        return cls(
            joint=joint,
            stiffness=min(stiffest, limit / GIVE),
            limit=limit,
            both_ways=both_ways,
        )

    def update(self, position: float, rate: float) -> None:
        """Choose stick or slip for the next step, from the joint's position and
        velocity.
        """
        limit = self.limit
        if self.sliding != NOT_SLIDING:
            # reversed: stick, with the spring at the same force
            if self.sliding * rate <= 0:
                self.anchor = position - self.sliding * limit / self.stiffness
                self.sliding = NOT_SLIDING
            return
        force = self.stiffness * (position - self.anchor)
        if force > limit or (self.both_ways and -force > limit):
            self.sliding = float(np.sign(force))

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Write the stick-slip element's spring, or constant force, into `model` and
        `data`.
        """
        joint = self.joint
        model.jnt_stiffness[joint] = (
            self.stiffness if self.sliding == NOT_SLIDING else 0.0
        )
        model.qpos_spring[joint] = self.anchor
        data.qfrc_applied[joint] = -self.sliding * self.limit


@dataclass(frozen=True, slots=True)
class Ends:
    """Sliding ends of a strip's chain, at the gripper and at the loose edge; None for
    an end that does not slide.

    The grip slips under pull and not under compression. The loose edge slides both
    ways, held by `friction` times the normal force of the desk, `edge_weight` [N] of it
    at the edge itself, because the part behind the desk contact slides in one piece.
    """

    grip: Slide | None
    edge: Slide | None
    friction: float
    edge_weight: float

    @classmethod
    def at_rest(cls, model: StripModel, lumps: Lumps, joints: Joints) -> Self:
        """Ends of the chain of a lying strip: neither slides, the desk bears the full
        weight.
        """
        boundary = model.boundary
        gravity = -boundary.gravity[1]
        friction = boundary.edge_friction
        grip_force = boundary.grip_force * lumps.scale
        edge_force = friction * float(lumps.mass.sum()) * gravity
        return cls(
            grip=Slide.sticking(
                joints.grip, grip_force, lumps.along[-1], both_ways=False
            ),
            edge=Slide.sticking(
                joints.edge, edge_force, lumps.stiffest[0], both_ways=True
            ),
            friction=friction,
            edge_weight=0.5 * float(lumps.mass[0]) * gravity,
        )

    @property
    def slide(self) -> bool:
        """Whether an end of the chain can slide."""
        return self.grip is not None or self.edge is not None

    def update(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Choose stick or slip of both ends for the next step, from the state in
        `data`.
        """
        if not self.slide:
            return
        if self.edge is not None and data.ncon > 0:
            desk = model.geom("desk").id
            touching = (data.contact.geom == desk).any(axis=1) & (
                data.contact.efc_address >= 0
            )
            pressed = float(data.efc_force[data.contact.efc_address[touching]].sum())
            self.edge.limit = self.friction * (self.edge_weight + pressed)
        for slide in (self.grip, self.edge):
            if slide is not None:
                slide.update(
                    float(data.qpos[slide.joint]), float(data.qvel[slide.joint])
                )
        self.apply(model, data)

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Write the springs and forces of both sliding ends into the MuJoCo `model` and
        its `data`.
        """
        for slide in (self.grip, self.edge):
            if slide is not None:
                slide.apply(model, data)


OPENING = 2.0  # touch gaps by which the layers must have opened before they can touch
PULL = 2e-5  # m beyond a strip's reach: some three times its weight
LOST_TURN = np.pi  # rad that a hinge turns in a step of a diverging chain; 0.9 is known
STATE_SPEC = mujoco.mjtState.mjSTATE_INTEGRATION
# arrays compare slowly with a member
EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)


class ChainStrip:
    """Simulation of one strip as a chain of `links` links, flat at time 0 and held at
    its end.

    `points` (links + 1, 2) [m] are its nodes now, at arc lengths `arc` (links + 1,) [m]
    from the fixed edge; `touch` is the first touch of its layers. `foreign` forces act
    on it in addition to those of its model.
    """

    def __init__(
        self, model: StripModel, links: int, foreign: Sequence[ExtraForce]
    ) -> None:
        self._description = model
        self._links = links
        self._lumps = Lumps.from_model(model, links)
        # `_step` raises SimulationNotFinite: MuJoCo's warning would only add a line on
        # stderr
        mujoco.set_mju_user_warning(lambda _: None)
        self._use_model(compile_chain(model, links))
        self._joints = Joints.from_model(self._model, self._lumps.spans)
        self._loads = Loads(self._lumps, self._joints)
        self._foreign = ExtraForces(
            (*strip_laws(model), *foreign), Parts(model, self._lumps, self._joints)
        )
        self._ends = Ends.at_rest(model, self._lumps, self._joints)
        self._state = np.empty(mujoco.mj_stateSize(self._model, STATE_SPEC))
        self._grip = CommandedGrip.at_rest(np.array([model.mechanics.length, 0.0, 0.0]))
        self._held = True
        self._time = 0.0
        self._gap = NO_GAP
        self.arc = running_sums(self._lumps.spans)
        self.points = self._joints.nodes(self._data.qpos)
        self.touch: Touch | None = None
        self._approach()

    def release(self) -> None:
        """Release the grasped edge from the gripper."""
        self._held = False
        self._data.eq_active[0] = 0

    def advance(self, pose: Array, dt: float, parts: int) -> None:
        """Step to gripper `pose` (3,) [m, m, rad] in `dt` [s], in equal straight
        `parts`.

        Raises SimulationNotFinite when the simulation diverges.
        """
        start = self._grip.pose
        h = dt / parts
        self._pace(h)
        for part in range(1, parts + 1):
            grip = self._grip.to(start + (pose - start) * (part / parts), h)
            self._foreign.clear(self._model, self._data, h)
            self._loads.update(self._data, h)
            self._ends.update(self._model, self._data)
            self._foreign.add(self._model, self._data, self._time, h)
            if self.touch is None:
                self._step_until_touch(grip, h)
            else:
                self._step(grip, h)

            self._grip = grip
            self._time += h

    def holding_force(self) -> float:
        """Horizontal force [N] of the fixed edge on the strip during the last step."""
        along = self._data.site_xmat[0, :3] @ self._data.sensordata
        return float(along) / self._lumps.scale

    def grip_force(self) -> Array:
        """Force (2,) [N] along x and z of the strip on the gripper during the last
        step.
        """
        # the weld is the only one; its first rows are x, y, z
        rows = np.flatnonzero(self._data.efc_type == EQUALITY)[:3]
        if len(rows) < 3:
            return np.zeros(2)
        x, _, z = self._data.efc_force[rows]
        return np.array([x, z]) / self._lumps.scale

    def _approach(self) -> None:
        """Move the grasped edge to the stated length, and let the strip settle."""
        for pose in approach_poses(self._description):
            grip = self._grip.to(pose, LONGEST_STEP)
            self._loads.update(self._data, LONGEST_STEP)
            self._step(grip, LONGEST_STEP)
            self._data.qvel[:] *= VELOCITY_DECAY
            self._grip = grip
        self._grip = CommandedGrip.at_rest(self._grip.pose)

    def _step_until_touch(self, grip: CommandedGrip, h: float) -> None:
        """Advance by a step; if layers touch in it, repeat the step with solid
        layers.
        """
        mujoco.mj_getState(self._model, self._data, self._state, STATE_SPEC)
        before = self._gap
        self._step(grip, h)
        strip = self._description.mechanics
        self._gap = (
            layer_gap(self.points, self.arc, OPENING * strip.touch_gap) or NO_GAP
        )
        if self._gap.height <= strip.touch_gap:
            share, x, s = layer_touch(tuple(before), tuple(self._gap), strip.touch_gap)
            self.touch = Touch.in_shape(
                self._time + share * h, x, s, self.arc, self.points
            )
            layers = Layers.from_angles(self._joints.angles(self._data.qpos)[:-1])
            self._use_model(compile_chain(self._description, self._links, layers))
            self._pace(h)
            self._foreign.restore_damping(self._model)
            mujoco.mj_setState(self._model, self._data, self._state, STATE_SPEC)
            self._ends.apply(self._model, self._data)
            self._step(grip, h)

    def _step(self, grip: CommandedGrip, h: float) -> None:
        """Step MuJoCo by `h` [s] with the tip welded to `grip`; raises
        SimulationNotFinite.
        """
        data = self._data
        if self._held:
            x, z, pitch = self._within_reach(grip.target(self._grip, h))
            data.mocap_pos[0] = x, 0.0, z
            data.mocap_quat[0] = np.cos(pitch / 2), 0.0, -np.sin(pitch / 2), 0.0
        mujoco.mj_step(self._model, data)
        self.points = self._joints.nodes(data.qpos)

        diverged = data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number
        turn = h * np.abs(data.qvel[self._joints.hinges]).max()
        if diverged or not turn < LOST_TURN:
            raise SimulationNotFinite("chain", self._time + h)

    def _within_reach(self, target: Array) -> Array:
        """Copy of the weld's `target` (3,) [m, m, rad], moved to at most PULL beyond
        where the gripper holds the strip taut.

        A weld with a larger violation pulls so hard that the solver loses the weight in
        rounding.
        """
        distance = math.hypot(target[0], target[1])
        reach = self.arc[-1] + PULL
        if self._lumps.stretches or self._ends.slide or not reach < distance < math.inf:
            return target
        return target * (reach / distance, reach / distance, 1.0)

    def _pace(self, h: float) -> None:
        """Set the model's time step `h` [s], and the joints' damping for steps of that
        length.
        """
        if self._model.opt.timestep != h:
            self._model.opt.timestep = h
            self._model.dof_damping[self._joints.hinges] = (
                self._lumps.hinges.damping_at(h)
            )

    def _use_model(self, model: mujoco.MjModel) -> None:
        """Continue the simulation with another `model`, in its initial state."""
        self._model = model
        self._data = mujoco.MjData(model)


class Chain:
    """Strip engine of MuJoCo chains of `links` links, which are stepped one after the
    other.

    Steps longer than 5 ms are divided into equal parts along the straight line between
    poses. The simulation continues after the touch: the layers rest on each other. The
    grip is compliant (10 N pull it by 7 um on the paper's strip), so that a pose out of
    the strip's reach costs force and is no fault. `foreign` forces act on the strips in
    addition to those of their models.
    """

    def __init__(self, links: int = 60, foreign: Sequence[ExtraForce] = ()) -> None:
        self._links = links
        self._foreign = tuple(foreign)
        self._strips: list[ChainStrip] = []
        self._models: tuple[StripModel, ...] = ()

    def reset(self, models: Sequence[StripModel]) -> None:
        """Lay the strips flat and at rest at time 0, each gripped at x = its stated
        length, z = 0, pitch 0.
        """
        self._models = tuple(models)
        self._strips = [
            ChainStrip(model, self._links, self._foreign) for model in models
        ]

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance by `dt` [s] to gripper `poses` (n, 3) [m, m, rad] at the step's end.

        Raises SimulationNotFinite when a shape is not finite.
        """
        parts = max(1, int(np.ceil(dt / LONGEST_STEP - 1e-6)))
        for strip, pose in zip(self._strips, poses, strict=True):
            strip.advance(pose, dt, parts)
        return self._observe()

    def release(self) -> None:
        """Release all strips from their grippers: later gripper poses have no
        effect.
        """
        for strip in self._strips:
            strip.release()

    def shapes(self) -> Array:
        """Midlines (n, links + 1, 2) [m] of all strips, from the fixed to the grasped
        edge.
        """
        return np.stack([strip.points for strip in self._strips])

    def arc(self) -> Array:
        """Arc lengths (n, links + 1) [m] of the strips' nodes from the fixed edge."""
        return np.stack([strip.arc for strip in self._strips])

    def _observe(self) -> Observables:
        """Observables of all strips in their present shapes."""
        strips = self._strips
        heights = [model.observation.contact_height for model in self._models]
        pairs = list(zip(strips, heights, strict=True))
        return Observables(
            contact_x=np.array(
                [desk_contact(strip.points, height) for strip, height in pairs]
            ),
            tip=np.array([fold_tip(strip.points) for strip in strips]),
            holding_force=np.array([strip.holding_force() for strip in strips]),
            grip_force=np.array([strip.grip_force() for strip in strips]),
            touch=tuple(strip.touch for strip in strips),
        )
