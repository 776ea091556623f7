"""Look-ahead check that the joints can follow the gripper's motion and brake from it."""

from typing import NamedTuple

import numpy as np

from drivers.arm.plane import StripPlane
from drivers.franka import limits
from drivers.franka.kinematics import pose_and_jacobian
from drivers.franka.tracking import ELBOW_JOINT, joint_rates, joint_step
from drivers.limits import MotionLimits
from drivers.types import Array, Pose, Velocity

JOINT_MARGIN = 0.03  # rad that each joint keeps from its ends
NEWTON = 3  # Newton steps for one pose
POSE_TOLERANCE = 1e-3  # m or rad
REACTION = 0.015  # s until a braking is under way
VELOCITY_SHARE = 0.95  # of a joint's velocity; the rest is for the beginning of a braking
ACCELERATION_SHARE = 0.9  # of a joint's in a motion; the rest is for what changes on the way
CHANGE_SHARE = 1.6  # of a joint's acceleration, if all axes changed at once in the worst directions


class Soon(NamedTuple):
    """Pose, velocity and acceleration [m/s^2, rad/s^2] commanded for REACTION [s] from now."""

    pose: Pose
    velocity: Velocity
    acceleration: Velocity


class ReachGuard:
    """Checks joint limits on the motion REACTION ahead, and where braking from there would end.

    The elbow is taken to stay where the motion began. At both places each joint must have room, and
    what the motion asks of it, curvature included, must lie within VELOCITY_SHARE of its velocity
    and ACCELERATION_SHARE of its acceleration; what braking would ask, within its acceleration. So
    the arm can brake, whatever is commanded next. Where a change of all axes at once in the worst
    directions would ask CHANGE_SHARE of a joint's acceleration, it objects: there hardly any
    command could be followed.
    """

    def __init__(self, plane: StripPlane, motion: MotionLimits, joints: list[float]) -> None:
        """Check a motion that begins at `joints` (7,) [rad]."""
        self._plane = plane
        self._axes = motion.axes
        self._elbow = float(joints[ELBOW_JOINT])
        self._soon: Array = np.array(joints)
        self._rest: Array = np.array(joints)
        self._twists = _twists(plane)
        self._most = np.array([axis.acceleration for axis in motion.axes])
        self._jerk = np.array([axis.jerk for axis in motion.axes])

    def objection(self, soon: Soon) -> str:
        """Reason to end a motion that will be at `soon`; empty while the motion may go on."""
        speed, change = (
            np.array([rate.vx, rate.vz, rate.pitch_rate])
            for rate in (soon.velocity, soon.acceleration)
        )
        where = np.array([soon.pose.x, soon.pose.z, soon.pose.pitch])
        self._soon, here = self._track(self._soon, where)
        rest = where + speed * np.abs(speed) / (2 * self._most)
        self._rest, there = self._track(self._rest, rest)
        if here is None or there is None:
            return "the arm does not reach on"
        room = np.minimum(limits.margins(self._soon), limits.margins(self._rest))
        if room.min() < JOINT_MARGIN:
            return f"joint {int(room.argmin()) + 1} comes to its end"
        demand = self._demand(here, there, speed, change)
        if demand.max() > 1.0:
            return f"joint {int(demand.argmax()) + 1} could not follow any further"
        return ""

    def _demand(self, here: Array, there: Array, speed: Array, change: Array) -> Array:
        """Share (7,) of each joint's limits that a motion needs, and braking from it; 1 is all.

        `here` and `there` (7, 3) are joint rates per unit velocity of each axis: at the motion with
        `speed` (3,) and its derivative `change` (3,), and where braking from it ends.
        """
        peak = np.minimum(self._most, np.sqrt(np.abs(speed) * self._jerk))
        braking = -np.sign(speed) * peak
        turning = here @ speed
        later = pose_and_jacobian(self._soon + REACTION * turning)[1]
        # rad/s^2 that the path's curvature asks at constant velocity
        bending = (joint_rates(later, self._twists) @ speed - turning) / REACTION
        demand: Array = np.maximum.reduce(
            [
                # the motion: velocity, acceleration; braking at once, and at its end
                self._rate_shares(turning),
                np.abs(here @ change + bending) / limits.ACCELERATION / ACCELERATION_SHARE,
                np.abs(here @ braking + bending) / limits.ACCELERATION,
                np.abs(there @ braking) / limits.ACCELERATION,
                # a change of all axes at once where the arm would rest
                np.abs(there) @ self._most / limits.ACCELERATION / CHANGE_SHARE,
            ]
        )
        return demand

    def _track(self, joints: Array, where: Array) -> tuple[Array, Array | None]:
        """Joints (7,) [rad] at pose `where` (3,), and their rates (7, 3) per velocity of each axis.

        Searched from near `joints` (7,); the rates are None where the pose is out of reach.
        """
        target = self._plane.matrix(*where.tolist())
        for _ in range(NEWTON):
            reached, jac = pose_and_jacobian(joints)
            step = joint_step(joints, reached, jac, target, self._elbow)
            joints = joints + step
        if not float(np.abs(step).max()) < POSE_TOLERANCE:
            return joints, None
        return joints, joint_rates(jac, self._twists)

    def _rate_shares(self, rates: Array) -> Array:
        """Joint `rates` (7,) [rad/s] as shares of their limits; 1 is the limit."""
        low, high = limits.velocity_bounds(self._soon)
        return np.asarray(np.maximum(rates / high, rates / low) / VELOCITY_SHARE, dtype=np.float64)


def _twists(plane: StripPlane) -> Array:
    """Hand twist and elbow rate (7, 3) in the base per unit of velocity on x, z and pitch."""
    here, small = plane.matrix(0.0, 0.0, 0.0), 1e-6
    x, z = (plane.matrix(*at)[:3, 3] - here[:3, 3] for at in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    turn = (plane.matrix(0.0, 0.0, small)[:3, :3] @ here[:3, :3].T) / small  # per rad of pitch
    columns = np.zeros((7, 3))
    columns[:3, 0], columns[:3, 1] = x, z
    columns[3:6, 2] = turn[2, 1], turn[0, 2], turn[1, 0]
    return columns
