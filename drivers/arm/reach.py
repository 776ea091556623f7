"""Whether the arm can follow a gripper path: before a motion, and ahead during every motion."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from drivers.arm.plane import StripPlane
from drivers.franka import limits
from drivers.franka.inverse_kinematics import (
    ELBOW_JOINT,
    Unreachable,
    joint_rates,
    manipulability,
    solve,
    track,
)
from drivers.franka.kinematics import HOME, jacobian, pose_and_jacobian
from drivers.installation import Installation, MotionLimits
from drivers.motion import PredictedMotion
from drivers.types import ZERO_VELOCITY, Array, Pose, Velocity, frozen

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
MOST_PROBLEMS = 5  # problems of one path, after which it is given up
ELBOWS = (-1.2, -0.9, -0.6, -0.3, -0.15, 0.0, 0.15, 0.3, 0.6, 0.9, 1.2)  # rad of joint 3, tried

# ahead in a motion
JOINT_MARGIN = 0.03  # rad that each joint keeps from its ends
ITERATIONS, TOLERANCE = 3, 1e-3  # Newton steps for one pose, and rad that the last may have
REACTION = 0.015  # s until a braking is under way
VELOCITY_SHARE = 0.95  # of a joint's velocity; the rest is for the beginning of a braking
ACCELERATION_SHARE = 0.9  # of a joint's acceleration in a motion; the rest is for changes of it
CHANGE_SHARE = 1.6  # of a joint's acceleration, for the worst simultaneous change of all axes


@dataclass(frozen=True, slots=True)
class Problem:
    """Gripper pose (x, z [m], pitch [rad]) that the arm cannot reach, and the reason."""

    x: float
    z: float
    pitch: float
    reason: str

    def __str__(self) -> str:
        """Pose and reason as a text for the operator."""
        place = f"x {1e3 * self.x:.0f} mm, z {1e3 * self.z:.0f} mm"
        return f"{place}, pitch {np.degrees(self.pitch):.0f} deg: {self.reason}"


@dataclass(frozen=True, slots=True)
class Reach:
    """Result of tracking a gripper path from one start posture: margin, progress and problems.

    The hand `turned` or not, `start` joints (7,) [rad] at the first pose, smallest joint `margin`
    [rad] and its `joint`, number of poses `followed`, and the first `problems` in path order.
    """

    turned: bool
    start: Array
    margin: float
    joint: int
    followed: int
    problems: tuple[Problem, ...]

    @property
    def allowed(self) -> bool:
        """Whether the arm can follow the whole path."""
        return not self.problems


def plan_reach(
    installation: Installation, path: Array, speeds: Array, elbows: tuple[float, ...] = ELBOWS
) -> Reach:
    """Choose the start posture with which the arm best follows a gripper path.

    `path` (n, 3) is x, z [m] and pitch [rad], `speeds` (n,) [m/s] along it. Tries both hand
    orientations and all `elbows` [rad], constant along the path. Prefers no problems, then the
    longest part followed, then the largest joint margin. The driver's guard must not brake on the
    path before the lay, which depends on where the layers touch.
    """
    poses, times = densify(path, speeds)
    frame = installation.mounting.transform()
    planes = [StripPlane(frame, turned=turned) for turned in (False, True)]
    candidates = [reach for plane in planes for reach in _postures(plane, poses, times, elbows)]
    if not candidates:
        x, z, pitch = path[0].tolist()
        first = Problem(x, z, pitch, "no posture of the arm brings the hand there")
        return Reach(False, HOME, 0.0, 1, 0, (first,))
    candidates.sort(key=lambda reach: (reach.allowed, reach.followed, reach.margin), reverse=True)
    braked = list[Reach]()
    for candidate in filter(lambda reach: reach.allowed, candidates):
        guard = ReachGuard(planes[candidate.turned], installation.limits, candidate.start.tolist())
        stop = _first_braking(guard, poses, times)
        if stop is None:
            return candidate
        after_lift = stop.pitch > HANGING
        braked.append(candidate if after_lift else replace(candidate, problems=(stop,)))
    return max(braked, key=lambda reach: (reach.allowed, reach.margin), default=candidates[0])


def _postures(
    plane: StripPlane, poses: Array, times: Array, elbows: tuple[float, ...]
) -> Iterator[Reach]:
    """Yield the result of tracking `poses` from each start posture, one for each elbow angle."""
    for elbow in elbows:
        seed = HOME + frozen([-elbow, 0, elbow, 0, 0, 0, 0])
        try:
            near = solve(plane.matrix(*poses[0].tolist()), seed)
        except Unreachable:
            continue
        tracked = track(near, plane.matrix(*poses[0].tolist()), elbow, PATH_ITERATIONS)
        if tracked is not None:
            yield _track_path(plane, poses, times, tracked[0])


def _track_path(plane: StripPlane, poses: Array, times: Array, start: Array) -> Reach:
    """Track the joints along `poses` (n, 3) from `start` (7,) [rad], up to MOST_PROBLEMS."""
    joints, problems, count = start, list[Problem](), 0
    margin, joint = np.inf, 0
    for pose, time in zip(poses, times, strict=True):
        x, z, pitch = pose.tolist()
        elbow = float(start[ELBOW_JOINT])
        tracked = track(joints, plane.matrix(x, z, pitch), elbow, PATH_ITERATIONS)
        if tracked is None:
            problems.append(Problem(x, z, pitch, "no posture of the arm brings the hand there"))
            break
        there = tracked[0]
        room = limits.margins(there)
        margin, joint = min((margin, joint), (float(room.min()), int(room.argmin())))
        reason = _step_objection(joints, there, time)
        if reason:
            problems.append(Problem(x, z, pitch, reason))
        if len(problems) >= MOST_PROBLEMS:
            break
        joints, count = there, count + 1
    return Reach(plane.turned, start, margin, joint + 1, count, tuple(problems))


def _first_braking(guard: "ReachGuard", poses: Array, times: Array) -> Problem | None:
    """The first of `poses` (n, 3), from the lift on, at which `guard` would brake the arm."""
    rates = np.diff(poses, axis=0) / times[1:, None]
    for (x, z, pitch), rate in zip(poses.tolist(), rates.tolist(), strict=False):
        reason = guard.objection(PredictedMotion(Pose(x, z, pitch), Velocity(*rate), ZERO_VELOCITY))
        if reason and pitch > 0.0:
            return Problem(x, z, pitch, reason)
    return None


def _step_objection(joints: Array, there: Array, time: float) -> str:
    """Reason to refuse a step from `joints` to `there` (7,) in `time` [s]; empty for none."""
    room, joint = float(limits.margins(there).min()), int(limits.margins(there).argmin()) + 1
    if room < PATH_MARGIN:
        return (
            f"joint {joint} comes within {room:.2f} rad of its end, allowed {PATH_MARGIN:.2f} rad"
        )
    low, high = limits.velocity_bounds(there)
    rate = (there - joints) / time
    used = np.maximum(
        rate / (PATH_VELOCITY_SHARE * high + RATE_FLOOR),
        rate / (PATH_VELOCITY_SHARE * low - RATE_FLOOR),
    )
    if used.max() > 1.0:
        worst = int(used.argmax())
        return f"joint {worst + 1} would turn at {abs(rate[worst]):.2f} rad/s, more than it may"
    if manipulability(jacobian(there)) < SINGULAR:
        return "the arm would be close to a singular posture, stretched or folded"
    return ""


def densify(path: Array, speeds: Array) -> tuple[Array, Array]:
    """Poses (m, 3) along `path` at most POSE_STEP apart, and times (m,) [s] from pose to pose."""
    poses, times = [path[:1]], [np.array([1.0])]  # s to the first pose: the arm stands there
    for here, there, speed in zip(path[:-1], path[1:], speeds[1:], strict=True):
        travel = float(np.hypot(*(there - here)[:2]))
        turn = abs(float(there[2] - here[2])) / PITCH_PER_METRE
        count = max(1, int(np.ceil(max(travel, turn) / POSE_STEP)))
        shares = np.arange(1, count + 1)[:, None] / count
        poses.append(here + shares * (there - here))
        times.append(np.full(count, max(travel, turn, SHORTEST_STEP) / speed / count))
    return np.concatenate(poses), np.concatenate(times)


class ReachGuard:
    """Check of joint limits at the motion REACTION ahead, and where braking from there would end.

    At both poses, with the elbow where the motion began, each joint must be away from its ends and
    need at most VELOCITY_SHARE of its velocity, ACCELERATION_SHARE of its acceleration for the
    motion (curvature included), its full acceleration for braking, and CHANGE_SHARE of it for the
    worst simultaneous change of all axes. So the arm can brake whatever is commanded next.
    """

    def __init__(self, plane: StripPlane, motion: MotionLimits, joints: list[float]) -> None:
        """Check a motion in `plane` that begins at `joints` (7,) [rad], with its axes' limits."""
        self._plane = plane
        self._elbow = float(joints[ELBOW_JOINT])
        self._soon: Array = np.array(joints)
        self._rest: Array = np.array(joints)
        self._twists = _twists(plane)
        self._most = np.array([axis.acceleration for axis in motion.axes])
        self._jerk = np.array([axis.jerk for axis in motion.axes])

    def objection(self, soon: PredictedMotion) -> str:
        """Reason to stop a motion predicted to be at `soon`; empty while it may continue."""
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
                # the motion: velocity, acceleration; braking now, and at its end
                self._rate_shares(turning),
                np.abs(here @ change + bending) / limits.ACCELERATION / ACCELERATION_SHARE,
                np.abs(here @ braking + bending) / limits.ACCELERATION,
                np.abs(there @ braking) / limits.ACCELERATION,
                # a simultaneous change of all axes where the arm would rest
                np.abs(there) @ self._most / limits.ACCELERATION / CHANGE_SHARE,
            ]
        )
        return demand

    def _track(self, joints: Array, where: Array) -> tuple[Array, Array | None]:
        """Joints (7,) [rad] at pose `where` (3,), and their rates (7, 3) per velocity of each axis.

        Searched from near `joints` (7,); the rates are None where the pose is out of reach.
        """
        target = self._plane.matrix(*where.tolist())
        tracked = track(joints, target, self._elbow, ITERATIONS, TOLERANCE)
        if tracked is None:
            return joints, None
        return tracked[0], joint_rates(tracked[1], self._twists)

    def _rate_shares(self, rates: Array) -> Array:
        """Joint `rates` (7,) [rad/s] as shares of their limits; 1 is the limit."""
        low, high = limits.velocity_bounds(self._soon)
        return np.asarray(np.maximum(rates / high, rates / low) / VELOCITY_SHARE, dtype=np.float64)


def _twists(plane: StripPlane) -> Array:
    """Hand twist and elbow rate in the base, (7, 3) [m, rad], per unit velocity of x, z, pitch."""
    here, small = plane.matrix(0.0, 0.0, 0.0), 1e-6
    x, z = (plane.matrix(*at)[:3, 3] - here[:3, 3] for at in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    turn = (plane.matrix(0.0, 0.0, small)[:3, :3] @ here[:3, :3].T) / small  # per rad of pitch
    columns = np.zeros((7, 3))
    columns[:3, 0], columns[:3, 1] = x, z
    columns[3:6, 2] = turn[2, 1], turn[0, 2], turn[1, 0]
    return columns
