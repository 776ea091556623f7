"""Posture and commanded motion of the emulated arm at one tick."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from drivers.franka import limits
from drivers.franka.kinematics import elbow, pose_and_jacobian
from drivers.twin.server.limits import TICK, Course, still, twist_of
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Posture:
    """Joints (7,) with the poses that follow from them, the commanded tool pose (4, 4), and the
    rates of all three.

    The twin's arm stands at its commanded joints; `reached` differs from `pose` by the residual of
    one Newton step.
    """

    q: Array  # (7,) rad
    reached: Array  # (4, 4), tool in the base
    jacobian: Array  # (6, 7)
    pose: Array  # (4, 4), commanded
    elbow: float  # rad, commanded
    joints: Course  # (7,)
    tool: Course  # (6,)
    swing: Course  # (1,), of the elbow

    @classmethod
    def resting(cls, q: Array, tool: Array) -> Self:
        """At rest with joints (7,) [rad] and a tool (4, 4) on the flange."""
        reached, jacobian = pose_and_jacobian(q, tool)
        return cls(q, reached, jacobian, reached, elbow(q)[0], still(7), still(6), still(1))

    @property
    def elbow_sign(self) -> float:
        """1 or -1, on which side of its offset the elbow is flexed."""
        return elbow(self.q)[1]

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves."""
        return not self.joints.velocity.any()

    def moved(self, q: Array, tool: Array) -> Self:
        """One tick on with joints `q` (7,) [rad]; the commanded pose follows them."""
        reached, jacobian = pose_and_jacobian(q, tool)
        angle = elbow(q)[0]
        return replace(
            self,
            q=q,
            reached=reached,
            jacobian=jacobian,
            pose=reached,
            elbow=angle,
            joints=self.joints.step((q - self.q) / TICK),
            tool=self.tool.step(twist_of(self.pose, reached)),
            swing=self.swing.step(np.array([angle - self.elbow]) / TICK),
        )

    def braked(self, tool: Array) -> Self:
        """One tick of braking: all joints come to rest together, at their largest deceleration."""
        left = float((np.abs(self.joints.velocity) / limits.ACCELERATION).max())
        if left <= TICK:
            return self.resting(self.q, tool)
        velocity = self.joints.velocity * (1 - TICK / left)
        return replace(
            self.moved(self.q + TICK * velocity, tool),
            joints=Course(velocity, (velocity - self.joints.velocity) / TICK),
        )
