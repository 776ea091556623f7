"""Rehearsal of a fold in the air: the gripper's path, raised, with empty fingers."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cell.base.config.cell import CellFile
from cell.base.devices.fold_path import LOOSE
from cell.folding.feasibility import Feasibility
from cell.orchestrator.outcome import Outcome
from cell.orchestrator.snapshot import Drive, Snapshot
from cell.orchestrator.steps import Motion, close_hand, move, open_hand
from cell.setup.arm.manual_motion import home_joints, move_manually
from drivers.base.errors import ConfigurationError
from drivers.base.geometry import interpolate_columns
from drivers.base.installation import MotionLimits
from drivers.base.types import ZERO_VELOCITY, Array, Pose, Velocity
from drivers.franka.inverse_kinematics import ELBOW_JOINT
from drivers.franka.limits import FR3, JointLimits
from drivers.franka.reach import densify, plan_reach
from drivers.strip.file import StripFile

HOVER_HEIGHT = 0.2  # m above the fold
GAIN = 3.0  # 1/s, how fast the gripper returns to its path
EASE = 1.5  # duration of the path over that at its speeds without acceleration
RAMP = 0.3  # s to accelerate and to brake: without, the gripper overshoots by 9 mm
# cosine of the angle by which the path turns, below which the gripper rests there
CORNER = 0.7
# point of the fold's path with which it begins; those before avoid a lying strip
FIRST_USED = 2
GRASP = 2  # point of its own path at which the edge is grasped in the fold
LOOKAHEAD = 0.02  # s over which the path's velocity is taken


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Path of the gripper in a fold that is rehearsed in the air: a row of x [m], z [m]
    and pitch [rad] for each point, and speeds [m/s].
    """

    path: Array
    speeds: Array
    limits: MotionLimits

    def motion(self, _: Snapshot) -> Motion:
        """Motion through all parts of a fold, from approach to retreat, without a
        strip; it ends with an open hand.
        """
        last = len(self.path) - 1
        release = last - 1  # before the retreat
        yield from move(Pose.from_array(self.path[0]))
        yield from open_hand()
        yield from self._follow(0, GRASP)
        yield from close_hand()
        yield from self._follow(GRASP, release)
        yield from open_hand(LOOSE)
        yield from self._follow(release, last)
        return (yield from open_hand())

    def _follow(self, first: int, last: int) -> Motion:
        """Motion along the path from the point with the index `first` to that with the
        index `last`, which stops at each sharp corner.
        """
        stops = [first, *self._corners(first, last), last]
        for begin, end in pairwise(stops[:-1]):
            yield from self._follow_part(begin, end)
        return (yield from self._follow_part(*stops[-2:]))

    def _corners(self, first: int, last: int) -> list[int]:
        """Indices of the points, between those numbered `first` and `last`, at which
        the path turns by a sharp angle.
        """
        legs = np.diff(self.path[first : last + 1, :2], axis=0)
        lengths = np.linalg.norm(legs, axis=1)
        least = CORNER * lengths[1:] * lengths[:-1]
        sharp = (legs[1:] * legs[:-1]).sum(axis=1) < least
        return (first + 1 + np.flatnonzero(sharp)).tolist()

    def _follow_part(self, first: int, last: int) -> Motion:
        """Motion along the path between two corners, from the point `first` to the
        point `last`, that speeds up and slows down smoothly.
        """
        part = slice(first, last + 1)
        poses, times = densify(self.path[part], self.speeds[part])
        due = EASE * np.concatenate([[0.0], np.cumsum(times[1:])])
        duration = due[-1]
        fastest = np.array([axis.velocity for axis in self.limits.axes])
        snapshot = yield Drive(ZERO_VELOCITY)
        start = snapshot.time

        while (time := snapshot.time - start) < duration + min(RAMP, duration):
            later = time + LOOKAHEAD
            eased = [_eased_time(time, duration), _eased_time(later, duration)]
            target, ahead = interpolate_columns(np.array(eased), due, poses)
            error = target - snapshot.arm.commanded.as_array()
            rate = np.clip(
                (ahead - target) / LOOKAHEAD + GAIN * error, -fastest, fastest
            )
            snapshot = yield Drive(Velocity(*rate.tolist()))

        return (yield from move(Pose.from_array(poses[-1])))


def rehearsal(
    settings: CellFile,
    strip: StripFile,
    path: Array,
    speeds: Array,
    elbow: float | None = None,
    limits: JointLimits = FR3,
) -> Rehearsal:
    """Rehearsal in the air of a fold along `path`, with a row of x [m], z [m] and pitch
    [rad] for each point, raised by a fixed height.

    `speeds` (n,) [m/s] are those of the fold. Parts that only avoid a lying strip are
    left out. With an `elbow` [rad] a Franka arm must reach the path, its joints within
    `limits`. Raises ConfigurationError where the workspace or the arm ends below the
    fold.
    """
    installation = settings.installation
    raised = np.add(path[FIRST_USED:], (0.0, HOVER_HEIGHT, 0.0))
    speeds = speeds[FIRST_USED:]
    top = raised[:, 1].max()
    ceiling = installation.workspace.z[1]
    if top > ceiling:
        raise ConfigurationError(
            f"--rehearse: the fold of {strip.name} in the air reaches z {top:.2f} m,"
            f" the workspace ends at {ceiling:.2f} m; raise installation.workspace.z in"
            " cell.yaml"
        )

    if elbow is not None:
        reach = plan_reach(
            installation, path=raised, speeds=speeds, elbows=(elbow,), limits=limits
        )
        if not reach.allowed:
            raise ConfigurationError(
                "--rehearse: the arm cannot follow the fold in the air:"
                f" {reach.problems[0]}; see `cell fold --dry-run --arm fci`"
            )

    return Rehearsal(raised, speeds, installation.limits)


def rehearse(
    foreseen: Feasibility, interrupted: Callable[[], bool] = lambda: False
) -> Outcome:
    """Carry out the motion of a `foreseen` fold in the air, without a strip and without
    a grasp, and return its outcome.

    Raises PreflightRefused for a fold with problems.
    """
    request = foreseen.require().request
    settings = request.settings
    strip = request.strip
    elbow, limits = None, FR3
    if foreseen.reach is not None:
        limits = foreseen.reach.limits
        elbow = home_joints(settings, strip)[ELBOW_JOINT]

    path = foreseen.path
    speeds = foreseen.speeds
    planned = rehearsal(settings, strip, path, speeds, elbow, limits)
    return move_manually(settings, request.trial, planned.motion, interrupted, strip)


def _eased_time(time: float, duration: float) -> float:
    """How far a smooth motion has come `time` [s] after its start, as the time [s] that
    the same way takes at full speed; the whole way takes `duration` [s] at full speed.
    """
    ramp = min(RAMP, duration)
    left = max(duration + ramp - time, 0.0)
    if time < ramp:
        return time**2 / (2 * ramp)
    return duration - left**2 / (2 * ramp) if left < ramp else time - ramp / 2
