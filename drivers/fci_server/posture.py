"""Posture and commanded motion of the emulated arm at one tick."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from drivers.fci_server.kernel import POSTURE_FIELDS, POSTURE_SIZE, place
from drivers.fci_server.limits import LIMIT_TABLE, TICK, Course, still, twist_of
from drivers.franka import limits
from drivers.franka.kinematics import from_last_joint
from drivers.types import Array


@dataclass(frozen=True)
class Posture:
    """Joints (7,) with the poses that follow from them, the commanded tool pose (4, 4), and the
    rates of all three, as one vector (POSTURE_SIZE,) whose parts `kernel.FIELDS` names.

    The twin's arm stands at its commanded joints; `reached` differs from `pose` by the residual of
    one Newton step.
    """

    vector: Array

    @classmethod
    def of(cls, q: Array, tool: Array, joints: Course) -> Self:
        """Joints (7,) [rad] on their `joints` course, the commanded pose of the tool (4, 4) being
        the one that they give.
        """
        vector = np.zeros(POSTURE_SIZE)
        vector[POSTURE_FIELDS["q"]] = q
        vector[POSTURE_FIELDS["velocity"]] = joints.velocity
        vector[POSTURE_FIELDS["acceleration"]] = joints.acceleration
        place(vector, from_last_joint(tool).ravel(), LIMIT_TABLE)
        vector[POSTURE_FIELDS["pose"]] = vector[POSTURE_FIELDS["reached"]]
        vector[POSTURE_FIELDS["elbow"]][0] = q[2]
        return cls(vector)

    @classmethod
    def resting(cls, q: Array, tool: Array) -> Self:
        """At rest with joints (7,) [rad] and a tool (4, 4) on the flange."""
        return cls.of(q, tool, still(7))

    @cached_property
    def q(self) -> Array:
        """Joints (7,) [rad]."""
        return self.vector[POSTURE_FIELDS["q"]]

    @cached_property
    def joints(self) -> Course:
        """Course of the joints (7,)."""
        return Course(
            self.vector[POSTURE_FIELDS["velocity"]], self.vector[POSTURE_FIELDS["acceleration"]]
        )

    @cached_property
    def reached(self) -> Array:
        """Pose of the tool (4, 4) in the base."""
        return self.vector[POSTURE_FIELDS["reached"]].reshape(4, 4)

    @cached_property
    def jacobian(self) -> Array:
        """Jacobian (6, 7) of the tool in the base."""
        return self.vector[POSTURE_FIELDS["jacobian"]].reshape(6, 7)

    @cached_property
    def pose(self) -> Array:
        """Commanded pose of the tool (4, 4) in the base."""
        return self.vector[POSTURE_FIELDS["pose"]].reshape(4, 4)

    @cached_property
    def tool(self) -> Course:
        """Course of the tool (6,)."""
        return Course(self.vector[POSTURE_FIELDS["twist"]], self.vector[POSTURE_FIELDS["change"]])

    @property
    def elbow(self) -> float:
        """Commanded angle of the elbow [rad]."""
        return float(self.vector[POSTURE_FIELDS["elbow"].start])

    @property
    def elbow_sign(self) -> float:
        """1 or -1, on which side of its offset the elbow is flexed."""
        return float(self.vector[POSTURE_FIELDS["sign"].start])

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves."""
        return not self.joints.velocity.any()

    def move_on(self, q: Array, tool: Array, joints: Course) -> Self:
        """One tick on with joints `q` (7,) [rad] on their course; the commanded pose follows."""
        new = self.of(q, tool, joints)
        course = self.tool.step(twist_of(self.pose, new.reached))
        angle, rate, _ = self.vector[POSTURE_FIELDS["elbow"]].tolist()
        speed = (q[2] - angle) / TICK
        new.vector[POSTURE_FIELDS["twist"]], new.vector[POSTURE_FIELDS["change"]] = (
            course.velocity,
            course.acceleration,
        )
        new.vector[POSTURE_FIELDS["elbow"]] = q[2], speed, (speed - rate) / TICK
        return new

    def brake(self, tool: Array) -> Self:
        """One tick of braking: all joints come to rest together, at their largest deceleration."""
        left = float((np.abs(self.joints.velocity) / limits.ACCELERATION).max())
        if left <= TICK:
            return self.resting(self.q, tool)
        course = self.joints.step(self.joints.velocity * (1 - TICK / left))
        return self.move_on(self.q + TICK * course.velocity, tool, course)
