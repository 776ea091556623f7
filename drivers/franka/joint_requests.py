"""Single requests to a robot in any posture: read its pose, move to joints, retreat."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import count, islice, pairwise
from math import isfinite
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from drivers.base.child import Child
from drivers.base.types import Array
from drivers.franka.collision import Solids
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.force import ForceGuard
from drivers.franka.inverse_kinematics import straight
from drivers.franka.joint_motion import follow_joints
from drivers.franka.limits import FR3, JointLimits
from drivers.franka.obstacles import (
    ARM_CLEARANCE,
    CLEARANCE_TOLERANCE,
    clear_path,
    solids_of,
)
from drivers.franka.process import (
    END_PATIENCE,
    RobotAccess,
    TerminationFlag,
    connection,
    receive,
    send,
)
from drivers.franka.settings import CollisionSettings, FciSettings

TICKS_PER_PROGRESS = 200  # states of a motion between two reports of its progress
SMALLEST_WAY = 1e-9  # rad, avoids a division by 0
REST_RATE = 0.01  # rad/s of a joint that stands, the noise of its measurement included

# of a retreat from a contact
AWAY = 0.03  # m at most
POSITION_STEP = 0.001  # m between the places that are solved
FORCE_RISE = 8.0  # N by which the force may rise during the retreat
SPEED_SHARE = 0.05  # share of the joints' speed
FREE = 0.3  # share of the allowed force at rest from which the arm counts as free
JOINT_MARGIN = 0.03  # rad that each joint keeps from its ends
LOOSENING = 2  # factor on the thresholds of the reflexes
# N, N m, N m: most that settings allow
FORCE_CAP, MOMENT_CAP, TORQUE_CAP = 100.0, 100.0, 87.0


@dataclass(frozen=True, slots=True)
class GoTo:
    """Request for a motion of the robot to `joints` (7,) [rad] at a `share` of full
    speed.

    `recover` first resets a reflex and retreats from what presses on the gripper;
    `reset_tool` sets the cell's tool and reads it back.
    """

    joints: list[float]
    share: float
    recover: bool = False
    reset_tool: bool = False


@dataclass(frozen=True, slots=True)
class MotionProgress:
    """Message of a motion under way: the `share` of its path behind it, 0 to 1."""

    share: float


def go_to(
    access: RobotAccess,
    request: GoTo,
    show: Callable[[float], object] = lambda _: None,
) -> None:
    """Move the robot as `request` states, and wait until it rests there; raises Fault.

    The path goes around where a straight one in joint space meets the arm itself, desk,
    clamp or floor. It may take as long as it takes at its speed, while `show` is told
    the share of it that is done. Interrupting this function ends the motion.
    """
    _run_in_process(access, request, show)


def hand_pose(access: RobotAccess) -> list[float]:
    """Read the hand's pose in the robot's base, a column-major 4x4 matrix (16,); moves
    nothing.

    Raises Fault, also where the robot's tool is not the cell's.
    """
    return _run_in_process(access, request=None, show=lambda _: None)


def _run_in_process(
    access: RobotAccess, request: GoTo | None, show: Callable[[float], object]
) -> list[float]:
    """Run `carry_out` in a child process; returns its answer, a pose (16,) or joints
    (7,) [rad].

    Its silence counts from the last message, not from the start of the motion.
    """
    child = Child(carry_out, access, request)
    try:
        while isinstance(
            answer := receive(child, access.settings.start), MotionProgress
        ):
            show(answer.share)
        joints: list[float] = answer
        return joints
    finally:
        child.close(END_PATIENCE)


def carry_out(pipe: Connection, access: RobotAccess, request: GoTo | None) -> None:
    """Send through `pipe` the robot's pose (16,), or its joints (7,) [rad] after
    `request`.
    """
    with connection(pipe, access) as robot:
        if request is None:
            robot.require_tool()
            send(pipe, list(robot.state().O_T_EE))
        else:
            send(pipe, _go(robot, access, request, pipe))


def _go(
    robot: Any, access: RobotAccess, request: GoTo, pipe: Connection
) -> list[float]:
    """Prepare, check and move the robot as `request` states; returns joints (7,) [rad]
    reached.
    """
    if request.recover:
        robot.recover()
    robot.require_ready()
    if request.reset_tool:
        robot.reset_tool()
    robot.require_tool()
    termination = TerminationFlag()
    solids = solids_of(access.installation)

    def interrupted() -> bool:
        return termination.is_set or pipe.poll()

    if request.recover:
        retreat(robot, access.settings, interrupted, solids, access.limits)
    robot.configure(access.settings.collision)
    guard = robot.tared_guard()
    reached = list(robot.state().q)
    path = clear_path(
        np.array(reached), np.array(request.joints), solids, access.limits
    )
    told = _told(pipe, [np.array(reached), *path])
    for joints in path:
        if interrupted():
            break
        if max(map(abs, robot.state().dq)) < REST_RATE:  # its force can be the tare
            guard = robot.tared_guard()
        reached = follow_joints(
            robot,
            joints=joints.tolist(),
            share=request.share,
            guard=guard,
            until=lambda state: told(state) or interrupted(),
        )
    termination.check()
    return reached


def _told(pipe: Connection, path: list[Array]) -> Callable[[Any], bool]:
    """Function that tells through `pipe`, now and then, how much of `path` is done.

    Given each state of the robot, it returns False.
    """
    lengths = [float(np.abs(b - a).max()) for a, b in pairwise(path)]
    whole = max(sum(lengths), SMALLEST_WAY)
    states = count()

    def told(state: Any) -> bool:
        if next(states) % TICKS_PER_PROGRESS == 0:
            ends = [np.abs(np.subtract(state.q_d, joints)).max() for joints in path[1:]]
            leg = int(np.argmin(ends))
            left = float(ends[leg]) + sum(lengths[leg + 1 :])
            send(pipe, MotionProgress(min(max(1.0 - left / whole, 0.0), 1.0)))
        return False

    return told


def retreat(
    robot: Any,
    settings: FciSettings,
    interrupted: Callable[[], bool],
    solids: Solids,
    limits: JointLimits = FR3,
) -> None:
    """Move a `robot` at rest along the force on its gripper, if that force is more than
    allowed.

    The thresholds of the reflexes, which would stop it, are increased meanwhile. Raises
    ArmFault where the force is NaN or rises during the motion, where the path leads
    towards one of the `solids`, or does not free the arm within AWAY.
    """
    allowed = settings.rest
    state = robot.state()
    size = _force_on_gripper(state)
    if size <= allowed:
        return
    if not isfinite(size):
        reason = (
            "the robot reports a force that is no number; check its log before it moves"
            " again"
        )
        raise ArmFault(Cause.PRESSED, reason)
    away = np.array(state.O_F_ext_hat_K[:3]) / size
    path = _steps_away(np.array(state.q), away, limits)
    _require_room(path, solids)
    robot.configure(_raise_thresholds(settings.collision, size))
    guard = ForceGuard(size + FORCE_RISE)

    def is_over(state: Any) -> bool:
        return interrupted() or _force_on_gripper(state) < FREE * allowed

    try:
        follow_joints(
            robot,
            joints=path[-1].tolist(),
            share=SPEED_SHARE,
            guard=guard,
            until=is_over,
        )
    finally:
        # of a robot that a reflex has stopped; motions set their own
        with suppress(ArmFault):
            robot.configure(settings.collision)
    after = _force_on_gripper(robot.state())
    if not after <= allowed:
        reason = (
            f"the gripper still feels {after:.1f} N after a retreat of {1e3 * AWAY:.0f}"
            f" mm from {size:.1f} N, allowed {allowed:.1f} N"
        )
        raise ArmFault(Cause.PRESSED, reason)


def _force_on_gripper(state: Any) -> float:
    """Size [N] of the external force on the gripper in the robot's `state`."""
    return float(np.linalg.norm(state.O_F_ext_hat_K[:3]))


def _steps_away(joints: Array, direction: Array, limits: JointLimits) -> Array:
    """Joints (n, 7) [rad] that move the gripper by AWAY along `direction` (3,), without
    a turn.
    """
    steps = islice(
        straight(joints, POSITION_STEP * direction), round(AWAY / POSITION_STEP)
    )
    path = np.array([joints, *steps])
    if not limits.margins(path[-1]).min() >= JOINT_MARGIN:
        words = (
            "no way leads out of the contact: a joint is at its end; free the arm by"
            " hand"
        )
        raise ArmFault(Cause.PRESSED, words)
    return path


def _require_room(path: Array, solids: Solids) -> None:
    """Raise ArmFault where joints `path` (n, 7) [rad] lead closer to a solid than is
    allowed.

    Allowed is ARM_CLEARANCE, or the clearance at the start of the path where that is
    smaller.
    """
    gaps = solids.clearance(path)
    allowed = np.minimum(gaps[0] - CLEARANCE_TOLERANCE, ARM_CLEARANCE)
    for box, gap, least in zip(solids.boxes, gaps.T, allowed, strict=True):
        if not gap.min() >= least:
            words = (
                f"the way out of the contact leads towards the {box.name}; free the arm"
                " by hand"
            )
            raise ArmFault(Cause.PRESSED, words)


def _raise_thresholds(collision: CollisionSettings, force: float) -> CollisionSettings:
    """Copy of `collision` with upper thresholds that allow a retreat from a `force`
    [N].
    """
    upper = {
        "force_upper": min(
            max(collision.force_upper, LOOSENING * force + FORCE_RISE), FORCE_CAP
        ),
        "moment_upper": min(LOOSENING * collision.moment_upper, MOMENT_CAP),
        "torque_upper": min(LOOSENING * collision.torque_upper, TORQUE_CAP),
    }
    return collision.model_copy(update=upper)
