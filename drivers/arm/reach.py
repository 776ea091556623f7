"""Check before a motion whether the arm can follow a gripper path: joint limits, margins, rates."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from drivers.arm.guard import ReachGuard, Soon
from drivers.arm.plane import StripPlane
from drivers.franka.inverse import Unreachable, manipulability, solve
from drivers.franka.kinematics import HOME, jacobian, pose_and_jacobian
from drivers.franka.limits import margins, velocity_bounds
from drivers.franka.tracking import ELBOW_JOINT, joint_step
from drivers.installation import Installation
from drivers.types import ZERO_VELOCITY, Array, Pose, Velocity, frozen

POSE_STEP = 0.01  # m along the path at most between poses that are solved
PITCH_PER_METRE = 5  # rad of pitch that count as one metre along the path
SHORTEST_STEP = 1e-6  # m that a step counts at least, so that each takes some time
RATE_FLOOR = 1e-9  # rad/s, so that no velocity is divided by 0 where a joint may not turn
JOINT_MARGIN = 0.05  # rad that every joint keeps from its ends
SINGULAR = 0.02  # smallest singular value of the Jacobian that is allowed
VELOCITY_SHARE = 0.9  # of a joint's allowed velocity
NEWTON_ITERATIONS, POSE_TOLERANCE = 12, 1e-6  # iterations; m or rad that may be missing after them
HANGING = np.pi / 2 - 1e-6  # rad of pitch, from the end of the lift on
MOST_PROBLEMS = 5  # problems of one way, after which it is given up
ELBOWS = (-1.2, -0.9, -0.6, -0.3, -0.15, 0.0, 0.15, 0.3, 0.6, 0.9, 1.2)  # rad of joint 3, tried


@dataclass(frozen=True, slots=True)
class Problem:
    """Pose (x, z [m], pitch [rad]) that the arm cannot follow, and the reason."""

    x: float
    z: float
    pitch: float
    reason: str

    def __str__(self) -> str:
        """Place and reason as a text for the operator."""
        place = f"x {1e3 * self.x:.0f} mm, z {1e3 * self.z:.0f} mm"
        return f"{place}, pitch {np.degrees(self.pitch):.0f} deg: {self.reason}"


@dataclass(frozen=True, slots=True)
class Reach:
    """Result of tracking a path from one start posture: margin, progress and problems.

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
    """The best posture sequence with which the arm follows `path` (n, 3) at `speeds` (n,) [m/s].

    The elbow angle is constant on the whole path. Both hand orientations and all `elbows` [rad] are
    tried; the one without problems and with the largest margin wins, else the one that gets
    furthest. The driver's guard must not brake on it, or not before the lay, whose way depends on
    where the layers touch.
    """
    ways = [
        way
        for turned in (False, True)
        for way in _postures(installation, path, speeds, turned, elbows)
    ]
    if not ways:
        x, z, pitch = path[0].tolist()
        first = Problem(x, z, pitch, "no posture of the arm brings the hand there")
        return Reach(False, HOME, 0.0, 1, 0, (first,))
    ways.sort(key=lambda way: (way.allowed, way.followed, way.margin), reverse=True)
    braked = list[Reach]()
    for way in ways:
        if not way.allowed:
            break  # the ways with problems come last
        stop = _first_braking(installation, path, speeds, way)
        if stop is None:
            return way
        after_lift = stop.pitch > HANGING
        braked.append(way if after_lift else replace(way, problems=(stop,)))
    return max(braked, key=_progress) if braked else ways[0]


def _postures(
    installation: Installation, path: Array, speeds: Array, turned: bool, elbows: tuple[float, ...]
) -> Iterator[Reach]:
    """Yield the result of tracking `path` from each start posture, one for each elbow angle."""
    plane = StripPlane(installation.mounting.transform(), turned=turned)
    poses, times = dense(path, speeds)
    for elbow in elbows:
        seed = HOME + frozen([-elbow, 0, elbow, 0, 0, 0, 0])
        try:
            near = solve(plane.matrix(*poses[0].tolist()), seed)
        except Unreachable:
            continue
        start = _track_pose(near, plane.matrix(*poses[0].tolist()), elbow)
        if start is not None:
            yield _follow_path(plane, poses, times, start)


def _follow_path(plane: StripPlane, poses: Array, times: Array, start: Array) -> Reach:
    """Track the joints along `poses` from `start`, up to the first few problems."""
    joints, problems, count = start, list[Problem](), 0
    margin, joint = np.inf, 0
    for pose, time in zip(poses, times, strict=True):
        x, z, pitch = pose.tolist()
        there = _track_pose(joints, plane.matrix(x, z, pitch), float(start[ELBOW_JOINT]))
        if there is None:
            problems.append(Problem(x, z, pitch, "no posture of the arm brings the hand there"))
            break
        room = margins(there)
        margin, joint = min((margin, joint), (float(room.min()), int(room.argmin())))
        reason = _objection(joints, there, time)
        if reason:
            problems.append(Problem(x, z, pitch, reason))
        if len(problems) >= MOST_PROBLEMS:
            break
        joints, count = there, count + 1
    return Reach(plane.turned, start, margin, joint + 1, count, tuple(problems))


def _first_braking(
    installation: Installation, path: Array, speeds: Array, way: Reach
) -> Problem | None:
    """The first pose on a `way`, from the lift on, at which the arm's driver would brake."""
    plane = StripPlane(installation.mounting.transform(), turned=way.turned)
    guard = ReachGuard(plane, installation.limits, way.start.tolist())
    poses, times = dense(path, speeds)
    rates = np.diff(poses, axis=0) / times[1:, None]
    for (x, z, pitch), rate in zip(poses.tolist(), rates.tolist(), strict=False):
        reason = guard.objection(Soon(Pose(x, z, pitch), Velocity(*rate), ZERO_VELOCITY))
        if reason and pitch > 0.0:
            return Problem(x, z, pitch, reason)
    return None


def _progress(way: Reach) -> tuple[bool, float]:
    return way.allowed, way.margin


def _track_pose(joints: Array, pose: Array, elbow: float) -> Array | None:
    """Joints (7,) near `joints` at `pose` (4, 4) with the elbow at `elbow` [rad]; None if none."""
    for _ in range(NEWTON_ITERATIONS):
        reached, jac = pose_and_jacobian(joints)
        step = joint_step(joints, reached, jac, pose, elbow)
        joints = joints + step
        if float(np.abs(step).max()) < POSE_TOLERANCE:
            return joints
    return None


def _objection(joints: Array, there: Array, time: float) -> str:
    """Reason why a step from `joints` to `there` in `time` [s] is not allowed; empty if it is."""
    room, joint = float(margins(there).min()), int(margins(there).argmin()) + 1
    if room < JOINT_MARGIN:
        return (
            f"joint {joint} comes within {room:.2f} rad of its end, allowed {JOINT_MARGIN:.2f} rad"
        )
    low, high = velocity_bounds(there)
    rate = (there - joints) / time
    used = np.maximum(
        rate / (VELOCITY_SHARE * high + RATE_FLOOR), rate / (VELOCITY_SHARE * low - RATE_FLOOR)
    )
    if used.max() > 1.0:
        worst = int(used.argmax())
        return f"joint {worst + 1} would turn at {abs(rate[worst]):.2f} rad/s, more than it may"
    if manipulability(jacobian(there)) < SINGULAR:
        return "the arm would be stretched or folded so far that it cannot evade"
    return ""


def dense(path: Array, speeds: Array) -> tuple[Array, Array]:
    """Poses (m, 3) along `path` at most POSE_STEP apart, and the time [s] from each to the next."""
    poses, times = [path[:1]], [np.array([1.0])]  # s to the first pose: the arm stands there
    for here, there, speed in zip(path[:-1], path[1:], speeds[1:], strict=True):
        way = float(np.hypot(*(there - here)[:2]))
        turn = abs(float(there[2] - here[2])) / PITCH_PER_METRE
        count = max(1, int(np.ceil(max(way, turn) / POSE_STEP)))
        shares = np.arange(1, count + 1)[:, None] / count
        poses.append(here + shares * (there - here))
        times.append(np.full(count, max(way, turn, SHORTEST_STEP) / speed / count))
    return np.concatenate(poses), np.concatenate(times)
