"""Posture and commanded motion of the emulated arm at one tick."""

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Self

import numpy as np

from drivers.fci_server.limits import TICK, Course, still, twist_of
from drivers.franka import limits
from drivers.franka.kinematics import ELBOW_FLIP, pose_and_jacobian
from drivers.franka.tracking import ELBOW_JOINT
from drivers.types import Array

_SIZES = {
    "q": 7,  # rad
    "velocity": 7,  # rad/s
    "acceleration": 7,  # rad/s^2
    "reached": 16,  # tool in the base, row by row
    "jacobian": 42,  # row by row
    "pose": 16,  # commanded, row by row
    "twist": 6,  # m/s, rad/s
    "change": 6,  # m/s^2, rad/s^2
    "elbow": 3,  # rad, rad/s, rad/s^2
    "sign": 1,  # of the elbow
}
_ENDS = list(accumulate(_SIZES.values(), initial=0))
POSTURE_FIELDS = {name: slice(*span) for name, span in zip(_SIZES, pairwise(_ENDS), strict=True)}
POSTURE_SIZE = _ENDS[-1]


@dataclass(frozen=True)
class Posture:
    """Joints (7,) with the poses that follow from them, the commanded tool pose (4, 4), and the
    rates of all three, as one vector (POSTURE_SIZE,) whose parts POSTURE_FIELDS names: a state
    that is sent is a choice of its numbers.

    The twin's arm stands at its commanded joints; `reached` differs from `pose` by the residual of
    one Newton step.
    """

    vector: Array

    @classmethod
    def of(cls, q: Array, tool: Array, joints: Course) -> Self:
        """Joints (7,) [rad] on their `joints` course, the commanded pose of the tool (4, 4) being
        the one that they give.
        """
        reached, jacobian = pose_and_jacobian(q, tool)
        vector = np.zeros(POSTURE_SIZE)
        vector[POSTURE_FIELDS["q"]] = q
        vector[POSTURE_FIELDS["velocity"]] = joints.velocity
        vector[POSTURE_FIELDS["acceleration"]] = joints.acceleration
        vector[POSTURE_FIELDS["reached"]] = vector[POSTURE_FIELDS["pose"]] = reached.ravel()
        vector[POSTURE_FIELDS["jacobian"]] = jacobian.ravel()
        vector[POSTURE_FIELDS["elbow"].start] = q[ELBOW_JOINT]
        vector[POSTURE_FIELDS["sign"]] = 1.0 if q[3] > ELBOW_FLIP else -1.0
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

    @cached_property
    def swing(self) -> Array:
        """Commanded angle (3,) of the elbow with its two rates [rad, rad/s, rad/s^2]."""
        return self.vector[POSTURE_FIELDS["elbow"]]

    @property
    def elbow(self) -> float:
        """Commanded angle of the elbow [rad]."""
        return float(self.swing[0])

    @property
    def elbow_sign(self) -> float:
        """1 or -1, on which side of its offset the elbow is flexed."""
        return float(self.vector[POSTURE_FIELDS["sign"].start])

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves."""
        return not self.joints.velocity.any()

    def swing_to(self, elbow: float) -> Array:
        """The `swing` (3,) of an elbow that is at an angle [rad] one tick on."""
        angle, rate, _ = self.swing.tolist()
        speed = (elbow - angle) / TICK
        return np.array([elbow, speed, (speed - rate) / TICK])

    def with_command(self, pose: Array, course: Course, swing: Array) -> Self:
        """The same joints with another commanded `pose` (4, 4) of the tool on its course, and
        `swing` (3,) of the elbow.
        """
        vector = self.vector.copy()
        vector[POSTURE_FIELDS["pose"]] = pose.ravel()
        vector[POSTURE_FIELDS["twist"]] = course.velocity
        vector[POSTURE_FIELDS["change"]] = course.acceleration
        vector[POSTURE_FIELDS["elbow"]] = swing
        return type(self)(vector)

    def move_on(self, q: Array, tool: Array, joints: Course) -> Self:
        """One tick on with joints `q` (7,) [rad] on their course; the commanded pose follows."""
        new = self.of(q, tool, joints)
        course = self.tool.step(twist_of(self.pose, new.reached))
        return new.with_command(new.reached, course, self.swing_to(q[ELBOW_JOINT]))

    def brake(self, tool: Array) -> Self:
        """One tick of braking: all joints come to rest together, at their largest deceleration."""
        left = float((np.abs(self.joints.velocity) / limits.ACCELERATION).max())
        if left <= TICK:
            return self.resting(self.q, tool)
        course = self.joints.step(self.joints.velocity * (1 - TICK / left))
        return self.move_on(self.q + TICK * course.velocity, tool, course)
