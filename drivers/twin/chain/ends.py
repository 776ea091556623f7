"""Ends of a chain of links: the grip's weld, its approach, and ends that slide with
friction.
"""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from drivers.base.types import Array
from drivers.strip.model import StripModel
from drivers.twin.chain.lumps import Lumps
from drivers.twin.chain.spec import CONSTRAINT_SHARE, TIME_CONSTANT, Joints

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
class Grip:
    """Commanded gripper `pose` (3,) of x, z [m], pitch [rad], and its `rate` (3,) per
    second.
    """

    pose: Array
    rate: Array

    @classmethod
    def at_rest(cls, pose: Array) -> Self:
        """Grip at rest at the gripper pose `pose` (3,) [m, m, rad]."""
        return cls(pose, np.zeros(3))

    def to(self, pose: Array, h: float) -> Self:
        """Grip at `pose` (3,) [m, m, rad], with the rate of a move there within `h`
        [s].
        """
        return type(self)(pose, (pose - self.pose) / h)

    def target(self, before: Self, h: float) -> Array:
        """Weld target (3,) [m, m, rad] that puts the chain's tip at this grip after a
        step `h` [s].

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
    slack = model.mechanics.length - model.stated_length
    if slack == 0:
        return np.empty((0, 3))
    share = np.concatenate(
        [np.linspace(0.0, 1.0, APPROACH_STEPS + 1)[1:], np.ones(SETTLING_STEPS)]
    )
    reach = np.sqrt(2 * model.mechanics.length * max(slack, 0.0))
    height = APPROACH_HEIGHT * reach * np.sqrt(share * (1 - share))
    return np.stack(
        [model.mechanics.length - slack * share, height, np.zeros_like(share)], axis=1
    )


@dataclass(slots=True)
class Slide:
    """Stick-slip element: a stiff spring up to the force `limit`, then a constant
    force.

    It sticks again when the motion reverses. `joint` is the coordinate, `stiffness`
    that of the spring, all in the chain's scaled units; `rest` is the spring's rest
    position and `sliding` the sign of the motion.
    """

    joint: int
    stiffness: float
    limit: float
    both_ways: bool
    rest: float = 0.0
    sliding: float = NOT_SLIDING

    @classmethod
    def sticking(
        cls, joint: int | None, limit: float, stiffest: float, *, both_ways: bool
    ) -> Self | None:
        """Element at rest that yields by at most GIVE before it slides; None if it
        never does.
        """
        if joint is None or np.isinf(limit):
            return None
        return cls(joint, min(stiffest, limit / GIVE), limit, both_ways)

    def update(self, position: float, rate: float) -> None:
        """Choose stick or slip for the next step, from the joint's position and
        velocity.
        """
        if self.sliding != NOT_SLIDING:
            # reversed: stick, with the spring at the same force
            if self.sliding * rate <= 0:
                self.rest = position - self.sliding * self.limit / self.stiffness
                self.sliding = NOT_SLIDING
            return
        force = self.stiffness * (position - self.rest)
        if force > self.limit or (self.both_ways and -force > self.limit):
            self.sliding = float(np.sign(force))

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Write the stick-slip element's spring, or constant force, into `model` and
        `data`.
        """
        model.jnt_stiffness[self.joint] = (
            self.stiffness if self.sliding == NOT_SLIDING else 0.0
        )
        model.qpos_spring[self.joint] = self.rest
        data.qfrc_applied[self.joint] = -self.sliding * self.limit


@dataclass(frozen=True, slots=True)
class Ends:
    """Sliding ends of a chain, None for an end that does not slide.

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
        gravity = -float(model.boundary.gravity[1])
        friction = model.boundary.edge_friction
        grip_force = model.boundary.grip_force * lumps.scale
        edge_force = friction * float(lumps.mass.sum()) * gravity
        return cls(
            grip=Slide.sticking(
                joints.grip, grip_force, lumps.along[-1], both_ways=False
            ),
            edge=Slide.sticking(joints.edge, edge_force, lumps.held[0], both_ways=True),
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
        """Write the springs and forces of both ends into `model` and `data`."""
        for slide in (self.grip, self.edge):
            if slide is not None:
                slide.apply(model, data)
