"""Ends of a chain that slide with dry friction: a slipping grip, a loose fixed edge."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from drivers.strip.model import StripModel
from drivers.twin.chain.joints import Joints
from drivers.twin.chain.lumps import Lumps

NOT_SLIDING = 0.0
GIVE = 1e-4  # m, by which an end yields before it slides


@dataclass(slots=True)
class Slide:
    """Stick-slip element: a stiff spring up to the force `limit`, then a constant force.

    It sticks again when the motion reverses. `joint` is the coordinate, `stiffness` that of the
    spring, all in the chain's scaled units; `rest` is the spring's rest position and `sliding` the
    sign of the motion.
    """

    joint: int
    stiffness: float
    limit: float
    both_ways: bool
    rest: float = 0.0
    sliding: float = NOT_SLIDING

    def judge(self, position: float, rate: float) -> None:
        """Decide between stick and slip from the joint's position and velocity."""
        if self.sliding != NOT_SLIDING:
            if self.sliding * rate <= 0:  # reversed: stick, with the spring at the same force
                self.rest = position - self.sliding * self.limit / self.stiffness
                self.sliding = NOT_SLIDING
            return
        pull = self.stiffness * (position - self.rest)
        if (abs(pull) if self.both_ways else pull) > self.limit:
            self.sliding = float(np.sign(pull))

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Hold the joint, or resist its motion, in the next step."""
        model.jnt_stiffness[self.joint] = self.stiffness if self.sliding == NOT_SLIDING else 0.0
        model.qpos_spring[self.joint] = self.rest
        data.qfrc_applied[self.joint] = -self.sliding * self.limit


@dataclass(frozen=True, slots=True)
class Ends:
    """The sliding ends of a chain, if any.

    The grip slips under pull and not under compression. The loose edge slides both ways, held by
    `friction` times the normal force of the desk, `edge_weight` [N] of it at the edge itself,
    because the part behind the desk contact slides as a whole.
    """

    grip: Slide | None
    edge: Slide | None
    friction: float
    edge_weight: float

    @classmethod
    def of(cls, model: StripModel, lumps: Lumps, joints: Joints) -> Self:
        """Both ends of a chain at rest."""
        boundary, gravity = model.boundary, -float(model.boundary.gravity[1])
        grip: Slide | None = None
        edge: Slide | None = None
        hold = boundary.grip_force * lumps.scale
        if joints.grip is not None and not np.isinf(hold):
            grip = Slide(joints.grip, min(lumps.along[-1], hold / GIVE), hold, both_ways=False)
        if joints.edge is not None:
            friction = boundary.edge_friction * float(lumps.mass.sum()) * gravity
            edge = Slide(joints.edge, min(lumps.held[0], friction / GIVE), friction, both_ways=True)
        edge_weight = 0.5 * float(lumps.mass[0]) * gravity
        return cls(grip, edge, boundary.edge_friction, edge_weight)

    @property
    def slide(self) -> bool:
        """Whether any end can slide."""
        return self.grip is not None or self.edge is not None

    def renew(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Decide stick or slip for the next step from the state of `data`."""
        if not self.slide:
            return
        if self.edge is not None and data.ncon > 0:
            self.edge.limit = self.friction * (self.edge_weight + borne(model, data))
        for slide in (self.grip, self.edge):
            if slide is not None:
                slide.judge(float(data.qpos[slide.joint]), float(data.qvel[slide.joint]))
        self.apply(model, data)

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Write the ends' springs and forces into the model of a step."""
        for slide in (self.grip, self.edge):
            if slide is not None:
                slide.apply(model, data)


def borne(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Normal force [scaled N] of the desk on the chain in the last step."""
    desk = model.geom("desk").id
    touching = (data.contact.geom == desk).any(axis=1) & (data.contact.efc_address >= 0)
    return float(data.efc_force[data.contact.efc_address[touching]].sum())
