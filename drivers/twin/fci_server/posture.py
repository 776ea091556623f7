"""Posture and commanded motion of the emulated arm at one tick."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from drivers.base.motion import TICK
from drivers.base.types import Array
from drivers.franka import limits
from drivers.franka.inverse_kinematics import ELBOW_JOINT, twist_between
from drivers.franka.kinematics import ELBOW_FLIP, pose_and_jacobian


@dataclass(slots=True)
class Rates:
    """Commanded velocity and acceleration of the seven joints [rad, s] or of the tool's
    six axes [m, rad, s].
    """

    velocity: Array
    acceleration: Array

    def step(self, velocity: Array) -> "Rates":
        """Rates one tick of 1 ms later, with the new `velocity` (7,) or (6,) and the
        acceleration that leads to it.
        """
        return Rates(velocity, (velocity - self.velocity) / TICK)


def zero_rates(axes: int) -> Rates:
    """Rates of `axes` axes at rest: zero velocity and acceleration, each (axes,)."""
    return Rates(np.zeros(axes), np.zeros(axes))


@dataclass(frozen=True, slots=True)
class Posture:
    """Joints, tool pose and commanded motion of the emulated arm in one
    tick of 1 ms.

    At `q` (7,) [rad] with rates `joints` the tool is at `reached` (4, 4), with
    `jacobian` (6, 7). Commanded are the tool's `pose` (4, 4) with rates `tool` (6,),
    from which `reached` differs by one Newton step's residual, and the elbow's `swing`
    (3,): angle, rate, acceleration [rad, s].
    """

    q: Array
    joints: Rates
    reached: Array
    jacobian: Array
    pose: Array
    tool: Rates
    swing: Array

    @classmethod
    def at_joints(cls, q: Array, tool: Array, joints: Rates) -> Self:
        """Posture at joints `q` (7,) [rad] with the rates `joints`; the tool, at `tool`
        (4, 4) in the flange's frame, is commanded to rest where it is.
        """
        reached, jacobian = pose_and_jacobian(q, tool)
        swing = np.array([q[ELBOW_JOINT], 0.0, 0.0])
        return cls(
            q, joints, reached, jacobian, pose=reached, tool=zero_rates(6), swing=swing
        )

    @classmethod
    def resting(cls, q: Array, tool: Array) -> Self:
        """Posture at rest with joints `q` (7,) [rad] and `tool` (4, 4) in the flange's
        frame.
        """
        return cls.at_joints(q, tool, zero_rates(7))

    @property
    def elbow(self) -> float:
        """Commanded angle [rad] of the elbow, which is that of joint 3."""
        return float(self.swing[0])

    @property
    def elbow_sign(self) -> float:
        """Side to which the elbow is flexed, by joint 4: 1 or -1, as in libfranka."""
        return 1.0 if self.q[3] > ELBOW_FLIP else -1.0

    @property
    def at_rest(self) -> bool:
        """Whether all joints' commanded velocities are zero."""
        return not self.joints.velocity.any()

    def swing_to(self, elbow: float) -> Array:
        """Angle, rate and acceleration (3,) [rad, s] of an elbow that is at the angle
        `elbow` [rad] one tick of 1 ms later.
        """
        angle, rate, _ = self.swing.tolist()
        speed = (elbow - angle) / TICK
        return np.array([elbow, speed, (speed - rate) / TICK])

    def with_command(self, pose: Array, rates: Rates, swing: Array) -> Self:
        """Copy of the posture with another commanded tool `pose` (4, 4), its `rates`,
        and the elbow's angle, rate and acceleration `swing` (3,) [rad, s].
        """
        return replace(self, pose=pose, tool=rates, swing=swing)

    def move_on(self, q: Array, tool: Array, joints: Rates) -> Self:
        """Posture one tick of 1 ms later at joints `q` (7,) [rad]; the tool, at `tool`
        (4, 4) in the flange's frame, is commanded to follow.
        """
        new = self.at_joints(q, tool, joints)
        rates = self.tool.step(twist_of(self.pose, new.reached))
        return new.with_command(new.reached, rates, self.swing_to(q[ELBOW_JOINT]))

    def brake(self, tool: Array) -> Self:
        """Posture one tick of 1 ms later, after the hardest braking in which all joints
        stop together.
        """
        # s to rest
        time_left = float((np.abs(self.joints.velocity) / limits.ACCELERATION).max())
        if time_left <= TICK:
            return self.resting(self.q, tool)
        rates = self.joints.step(self.joints.velocity * (1 - TICK / time_left))
        return self.move_on(self.q + TICK * rates.velocity, tool, rates)


def twist_of(old: Array, new: Array) -> Array:
    """Twist (6,) [m/s, rad/s] in the base's frame that takes pose `old` (4, 4) to pose
    `new` (4, 4) in one tick of 1 ms.
    """
    return twist_between(old, new) / TICK
