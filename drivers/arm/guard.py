"""Keeps the gripper where the arm can brake: joints off their ends, and never stretched."""

import numpy as np

from drivers.arm.plane import StripPlane
from drivers.franka import limits
from drivers.franka.kinematics import pose_and_jacobian
from drivers.franka.tracking import ELBOW_JOINT, joint_rates, joint_step
from drivers.limits import MotionLimits
from drivers.types import Array, Pose, Velocity

ROOM = 0.03  # rad that each joint keeps from its ends
NEWTON = 3  # steps from one look to the next
REACHED = 1e-3  # m or rad
REACTION = 0.015  # s until a braking is under way
WORST = 1.3  # of a joint's acceleration, if all axes changed at once in the worst directions


class ReachGuard:
    """Looks where the arm would come to rest if it braked now, and whether it may go there.

    The elbow is taken to stay where the motion began. What is judged is the joints' room, and the
    acceleration that the limits on the gripper could ask of each joint there.
    """

    def __init__(self, plane: StripPlane, motion: MotionLimits, joints: list[float]) -> None:
        """From `joints` (7,) [rad], where the motion begins."""
        self._plane = plane
        self._axes = motion.axes
        self._joints: Array = np.array(joints)
        self._elbow = float(self._joints[ELBOW_JOINT])
        self._twists = _twists(plane)
        self._most = np.array([axis.acceleration for axis in motion.axes])

    def objection(self, pose: Pose, velocity: Velocity) -> str:
        """Why a motion at `pose` and `velocity` must not go on; empty while it may."""
        target = self._plane.matrix(*self._ahead(pose, velocity))
        for _ in range(NEWTON):
            reached, jac = pose_and_jacobian(self._joints)
            step = joint_step(self._joints, reached, jac, target, self._elbow)
            self._joints = self._joints + step
        if not float(np.abs(step).max()) < REACHED:
            return "the arm does not reach on"
        room = limits.margins(self._joints)
        if room.min() < ROOM:
            return f"joint {int(room.argmin()) + 1} comes to its end"
        demand = np.abs(joint_rates(jac, self._twists)) @ self._most / limits.ACCELERATION
        if demand.max() > WORST:
            return f"joint {int(demand.argmax()) + 1} could not follow any further"
        return ""

    def _ahead(self, pose: Pose, velocity: Velocity) -> tuple[float, float, float]:
        """Where the gripper would rest."""
        places = (pose.x, pose.z, pose.pitch)
        rates = (velocity.vx, velocity.vz, velocity.pitch_rate)
        x, z, pitch = (
            place + rate * (REACTION + abs(rate) / (2 * axis.acceleration))
            for place, rate, axis in zip(places, rates, self._axes, strict=True)
        )
        return x, z, pitch


def _twists(plane: StripPlane) -> Array:
    """Twist and elbow rate (7, 3) in the base of a unit of velocity on x, z and pitch."""
    here, small = plane.matrix(0.0, 0.0, 0.0), 1e-6
    x, z = (plane.matrix(*at)[:3, 3] - here[:3, 3] for at in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    turned = (plane.matrix(0.0, 0.0, small)[:3, :3] @ here[:3, :3].T) / small
    columns = np.zeros((7, 3))
    columns[:3, 0], columns[:3, 1] = x, z
    columns[3:6, 2] = turned[2, 1], turned[0, 2], turned[1, 0]
    return columns
