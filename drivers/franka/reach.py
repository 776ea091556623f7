"""Whether the arm can follow a gripper path: before a motion, and ahead during every
motion.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from drivers.base.geometry import lengths
from drivers.base.installation import Installation, MotionLimits
from drivers.base.motion import PredictedMotion
from drivers.base.types import ZERO_VELOCITY, Array, Pose, Velocity, frozen
from drivers.franka.inverse_kinematics import (
    ELBOW_JOINT,
    Unreachable,
    joint_rates,
    manipulability,
    solve,
    track,
)
from drivers.franka.kinematics import HOME, pose_and_jacobian
from drivers.franka.limits import ACCELERATION, FR3, FR3V2, JointLimits
from drivers.franka.plane import StripPlane

# of a whole path, before the motion
POSE_STEP = 0.01  # m along the path at most between poses that are solved
PITCH_PER_METRE = 5  # rad of pitch that count as one metre along the path
SHORTEST_STEP = 1e-6  # m that a step counts at least, so that each takes some time
RATE_FLOOR = 1e-9  # rad/s, avoids a division by 0 where a joint may not move
PATH_MARGIN = 0.05  # rad that every joint keeps from its ends
SINGULAR = 0.02  # smallest singular value of the Jacobian that is allowed
PATH_VELOCITY_SHARE = 0.9  # of a joint's allowed velocity
PATH_ITERATIONS = 12  # Newton steps for one pose
HANGING = np.pi / 2 - 1e-6  # rad of pitch, from the end of the lift on
NO_POSTURE = "no posture of the arm brings the hand there"
MOST_PROBLEMS = 5  # problems of one path, after which it is given up
WIDEST = FR3V2  # limits of all published ones
# rad of joint 3, tried
ELBOWS = (-1.2, -0.9, -0.6, -0.3, -0.15, 0.0, 0.15, 0.3, 0.6, 0.9, 1.2)

# ahead in a motion
JOINT_MARGIN = 0.03  # rad that each joint keeps from its ends
ITERATIONS = 3  # Newton steps for one pose
TOLERANCE = 1e-3  # rad, that the last of them may have
REACTION = 0.015  # s until a braking is under way
# of a joint's velocity; the rest is for the beginning of a braking
VELOCITY_SHARE = 0.95
# of a joint's acceleration in a motion; the rest is for changes of it
ACCELERATION_SHARE = 0.9
# of a joint's acceleration, for the worst simultaneous change of all axes
CHANGE_SHARE = 1.6


@dataclass(frozen=True, slots=True)
class Problem:
    """Gripper pose (x, z [m], pitch [rad]) that the arm cannot reach, and the
    reason.
    """

    x: float
    z: float
    pitch: float
    reason: str

    def __str__(self) -> str:
        """Pose and reason as a text for the operator."""
        position = f"x {1e3 * self.x:.0f} mm, z {1e3 * self.z:.0f} mm"
        return f"{position}, pitch {np.degrees(self.pitch):.0f} deg: {self.reason}"


@dataclass(frozen=True, slots=True)
class Reach:
    """How well the arm follows a gripper path from one start posture: joint margin,
    progress and problems.

    The hand `turned` or not, `start` joints (7,) [rad] at the first pose, smallest
    joint `margin` [rad] and its `joint`, number of poses `followed`, and the first
    `problems` in path order.
    """

    turned: bool
    start: Array
    margin: float
    joint: int
    followed: int
    problems: tuple[Problem, ...]

    @property
    def allowed(self) -> bool:
        """Whether the arm can follow the whole gripper path."""
        return not self.problems


def plan_reach(
    installation: Installation,
    path: Array,
    speeds: Array,
    elbows: tuple[float, ...] = ELBOWS,
    limits: JointLimits = FR3,
) -> Reach:
    """Choose the start posture with which the arm best follows a gripper path.

    `path` (n, 3) is x, z [m] and pitch [rad], `speeds` (n,) [m/s] along it. Tries both
    hand orientations and all `elbows` [rad], constant along the path. Prefers no
    problems, then the longest part followed, then the largest joint margin. The
    driver's guard must not brake on the path before the lay, which depends on where the
    layers touch.
    """
    poses, times = densify(path, speeds)
    frame = installation.mounting.transform()
    planes = [StripPlane(frame, turned=turned) for turned in (False, True)]

    tracked = list[Reach]()
    # beyond the limits it is told which joint ends
    for begun_in in (limits, WIDEST):
        for plane in planes:
            tracked += _postures(plane, poses, times, elbows, limits, begun_in)
        if tracked:
            break
    else:
        x, z, pitch = path[0].tolist()
        problem = Problem(x=x, z=z, pitch=pitch, reason=NO_POSTURE)
        return Reach(
            turned=False,
            start=HOME,
            margin=0.0,
            joint=1,
            followed=0,
            problems=(problem,),
        )

    tracked.sort(
        key=lambda reach: (reach.allowed, reach.followed, reach.margin), reverse=True
    )
    guarded = list[Reach]()  # those that the driver's guard would brake
    for reach in tracked:
        if reach.allowed:
            guard = ReachGuard(
                plane=planes[reach.turned],
                motion=installation.limits,
                joints=reach.start.tolist(),
                limits=limits,
            )
            braking = _first_braking(guard, poses, times)
            if braking is None:
                return reach
            in_lift = braking.pitch <= HANGING
            guarded.append(replace(reach, problems=(braking,)) if in_lift else reach)

    return max(
        guarded, key=lambda reach: (reach.allowed, reach.margin), default=tracked[0]
    )


def _postures(
    plane: StripPlane,
    poses: Array,
    times: Array,
    elbows: tuple[float, ...],
    limits: JointLimits,
    begun_in: JointLimits,
) -> Iterator[Reach]:
    """Yield the result of tracking `poses` from each start posture, one for each elbow
    angle, that the limits `begun_in` allow.
    """
    for elbow in elbows:
        seed = HOME + frozen([-elbow, 0, elbow, 0, 0, 0, 0])
        try:
            near = solve(plane.matrix(*poses[0].tolist()), seed, limits=begun_in)
        except Unreachable:
            continue
        tracked = track(near, plane.matrix(*poses[0].tolist()), elbow, PATH_ITERATIONS)
        if tracked is not None:
            yield _track_path(plane, poses, times, start=tracked[0], limits=limits)


def _track_path(
    plane: StripPlane, poses: Array, times: Array, start: Array, limits: JointLimits
) -> Reach:
    """Follow gripper `poses` (n, 3) with the joints from `start` (7,) [rad], until
    MOST_PROBLEMS have been found.
    """
    joints = start
    elbow = float(start[ELBOW_JOINT])
    problems = list[Problem]()
    followed = 0
    margins = np.full(len(start), np.inf)

    for (x, z, pitch), time in zip(poses.tolist(), times.tolist(), strict=True):
        tracked = track(joints, plane.matrix(x, z, pitch), elbow, PATH_ITERATIONS)
        if tracked is None:
            problems.append(Problem(x=x, z=z, pitch=pitch, reason=NO_POSTURE))
            break

        before = joints
        joints = tracked[0]
        margins = np.minimum(margins, limits.margins(joints))
        reason = _step_objection(before, joints, time, limits)
        if reason:
            problems.append(Problem(x, z, pitch, reason))
        if len(problems) >= MOST_PROBLEMS:
            break

        followed += 1

    return Reach(
        turned=plane.turned,
        start=start,
        margin=float(margins.min()),
        joint=int(margins.argmin()) + 1,
        followed=followed,
        problems=tuple(problems),
    )


def _first_braking(guard: "ReachGuard", poses: Array, times: Array) -> Problem | None:
    """First of `poses` (n, 3) [m, m, rad], from the lift on, at which `guard` would
    brake.
    """
    rates = np.diff(poses, axis=0) / times[1:, None]
    for (x, z, pitch), rate in zip(poses.tolist(), rates.tolist(), strict=False):
        reason = guard.objection(
            PredictedMotion(Pose(x, z, pitch), Velocity(*rate), ZERO_VELOCITY)
        )
        if reason and pitch > 0.0:
            return Problem(x, z, pitch, reason)
    return None


def _step_objection(
    joints: Array, target: Array, time: float, limits: JointLimits
) -> str:
    """Reason to refuse a step from `joints` to `target` (7,) in `time` [s]; empty for
    none.
    """
    margins = limits.margins(target)
    joint = int(margins.argmin())
    if margins[joint] < PATH_MARGIN:
        return (
            f"joint {joint + 1} comes within {margins[joint]:.2f} rad of its end, "
            f"allowed {PATH_MARGIN:.2f} rad"
        )

    low, high = limits.velocity_bounds(target)
    rate = (target - joints) / time
    used = np.maximum(
        rate / (PATH_VELOCITY_SHARE * high + RATE_FLOOR),
        rate / (PATH_VELOCITY_SHARE * low - RATE_FLOOR),
    )
    if used.max() > 1.0:
        worst = int(used.argmax())
        return (
            f"joint {worst + 1} would turn at {abs(rate[worst]):.2f} rad/s, more than"
            " it may"
        )
    if manipulability(pose_and_jacobian(target)[1]) < SINGULAR:
        return "the arm would be close to a singular posture, stretched or folded"

    return ""


def densify(path: Array, speeds: Array) -> tuple[Array, Array]:
    """Gripper poses (m, 3) along `path` at most POSE_STEP apart, and the times (m,) [s]
    from pose to pose.
    """
    poses = [path[:1]]
    times = [np.array([1.0])]  # s to the first pose: the arm stands there
    for first, second, speed in zip(path[:-1], path[1:], speeds[1:], strict=True):
        travel = float(lengths((second - first)[:2]))
        turn = abs(float(second[2] - first[2])) / PITCH_PER_METRE
        count = max(1, int(np.ceil(max(travel, turn) / POSE_STEP)))
        shares = np.arange(1, count + 1)[:, None] / count
        poses.append(first + shares * (second - first))
        times.append(np.full(count, max(travel, turn, SHORTEST_STEP) / speed / count))
    return np.concatenate(poses), np.concatenate(times)


class ReachGuard:
    """Check that the arm's joints keep their limits at the pose REACTION [s] ahead, and
    where braking from it ends.

    At both poses, with the elbow where the motion began, each joint must be away from
    its ends and need at most VELOCITY_SHARE of its velocity, ACCELERATION_SHARE of its
    acceleration for the motion (curvature included), its full acceleration for braking,
    and CHANGE_SHARE of it for the worst simultaneous change of all axes. So the arm can
    brake whatever is commanded next.
    """

    def __init__(
        self,
        plane: StripPlane,
        motion: MotionLimits,
        joints: list[float],
        limits: JointLimits = FR3,
    ) -> None:
        """Guard a motion in `plane` that begins at `joints` (7,) [rad], with its axes'
        limits.
        """
        self._plane = plane
        self._limits = limits
        self._elbow = float(joints[ELBOW_JOINT])
        self._ahead: Array = np.array(joints)
        self._at_rest: Array = np.array(joints)
        self._twists = _twists(plane)
        self._acceleration = np.array([axis.acceleration for axis in motion.axes])
        self._jerk = np.array([axis.jerk for axis in motion.axes])

    def objection(self, ahead: PredictedMotion) -> str:
        """Reason to stop a motion predicted to be at `ahead`; empty while it may
        continue.
        """
        pose = ahead.pose.as_array()
        velocity, acceleration = (
            np.array([*rate]) for rate in (ahead.velocity, ahead.acceleration)
        )
        self._ahead, rates = self._track(self._ahead, pose)
        stopped = pose + velocity * np.abs(velocity) / (2 * self._acceleration)
        self._at_rest, rest_rates = self._track(self._at_rest, stopped)
        if rates is None or rest_rates is None:
            return "the arm does not reach on"

        margins = np.minimum(
            self._limits.margins(self._ahead), self._limits.margins(self._at_rest)
        )
        if margins.min() < JOINT_MARGIN:
            return f"joint {int(margins.argmin()) + 1} comes to its end"

        demand = self._demand(rates, rest_rates, velocity, acceleration)
        if demand.max() > 1.0:
            return f"joint {int(demand.argmax()) + 1} could not follow any further"

        return ""

    def _demand(
        self, rates: Array, rest_rates: Array, velocity: Array, acceleration: Array
    ) -> Array:
        """Largest fraction (7,) of each joint's limits that a motion and braking from
        it need.

        `rates` and `rest_rates` (7, 3) are joint rates per unit velocity of each axis:
        at the motion with `velocity` and `acceleration` (3,), and where braking from it
        ends.
        """
        peak = np.minimum(self._acceleration, np.sqrt(np.abs(velocity) * self._jerk))
        braking = -np.sign(velocity) * peak
        turning = rates @ velocity
        later = pose_and_jacobian(self._ahead + REACTION * turning)[1]
        # rad/s^2 that the path's curvature asks at constant velocity
        bending = (joint_rates(later, self._twists) @ velocity - turning) / REACTION
        demand: Array = np.maximum.reduce(
            [
                # the motion: velocity, acceleration; braking now, and at its end
                self._rate_shares(turning),
                np.abs(rates @ acceleration + bending)
                / ACCELERATION
                / ACCELERATION_SHARE,
                np.abs(rates @ braking + bending) / ACCELERATION,
                np.abs(rest_rates @ braking) / ACCELERATION,
                # a simultaneous change of all axes where the arm would rest
                np.abs(rest_rates) @ self._acceleration / ACCELERATION / CHANGE_SHARE,
            ]
        )
        return demand

    def _track(self, joints: Array, pose: Array) -> tuple[Array, Array | None]:
        """Joints (7,) [rad] at the gripper `pose` (3,), and their rates (7, 3) per unit
        velocity of x, z and pitch.

        Searched from near `joints` (7,); the rates are None where the pose is out of
        reach.
        """
        x, z, pitch = pose.tolist()
        target = self._plane.matrix(x, z, pitch)
        tracked = track(
            q=joints,
            pose=target,
            elbow=self._elbow,
            iterations=ITERATIONS,
            tolerance=TOLERANCE,
        )
        if tracked is None:
            return joints, None
        reached, jacobian = tracked
        return reached, joint_rates(jacobian, self._twists)

    def _rate_shares(self, rates: Array) -> Array:
        """Joint `rates` (..., 7) [rad/s] as fractions of the greatest that the guard
        allows.
        """
        low, high = self._limits.velocity_bounds(self._ahead)
        return np.maximum(rates / high, rates / low) / VELOCITY_SHARE


def _twists(plane: StripPlane) -> Array:
    """Hand twist and elbow rate in the base, (7, 3) [m, rad], per unit velocity of x,
    z, pitch.
    """
    origin = plane.matrix(0.0, 0.0, 0.0)
    small = 1e-6
    # per rad of pitch
    turn = (plane.matrix(0.0, 0.0, small)[:3, :3] @ origin[:3, :3].T) / small
    twists = np.zeros((7, 3))
    twists[:3, 0] = plane.matrix(1.0, 0.0, 0.0)[:3, 3] - origin[:3, 3]
    twists[:3, 1] = plane.matrix(0.0, 1.0, 0.0)[:3, 3] - origin[:3, 3]
    twists[3:6, 2] = turn[2, 1], turn[0, 2], turn[1, 0]
    return twists
