"""Motion generators of the emulated robot: the next posture from a command, or a
violation.
"""

from collections.abc import Callable

import numpy as np

from drivers.base.motion import TICK
from drivers.base.types import Array
from drivers.franka.inverse_kinematics import joint_step, rotation
from drivers.twin.fci_server.configuration import rigid
from drivers.twin.fci_server.limits import (
    CARTESIAN_JOINT,
    JOINT,
    Violation,
    check_end,
    check_joints,
    check_swing,
    check_tool_rates,
)
from drivers.twin.fci_server.posture import Posture, twist_of
from drivers.twin.fci_server.wire import Generator, Reflex, RobotCommand, usable

Follow = Callable[[Posture, RobotCommand, Array], Posture]


def follow(
    generator: Generator, old: Posture, command: RobotCommand, tool: Array, first: bool
) -> Posture:
    """Posture of the arm one tick of 1 ms after `old` as it follows `command`, with the
    tool's pose `tool` (4, 4) in the flange's frame.

    `first` marks the first command of a motion, whose pose must be the arm's own.
    Raises Violation where the command breaks a limit of the robot.
    """
    try:
        new = _FOLLOW[generator](old, command, tool)
    except Violation as violation:
        if first and generator in _START and violation.reflex not in _NOT_START_ERRORS:
            raise Violation(_START[generator]) from None
        raise
    if command.finished:
        cartesian = generator in (
            Generator.CARTESIAN_POSE,
            Generator.CARTESIAN_VELOCITY,
        )
        check_end(new.joints, CARTESIAN_JOINT if cartesian else JOINT)
    return new


def readable(generator: Generator, command: RobotCommand) -> bool:
    """Whether the numbers of `command` that the motion `generator` uses are finite and
    not absurdly large.
    """
    fits = usable(_READ[generator](command))
    return fits and (command.elbow is None or usable(command.elbow))


def extrapolate(old: Posture, message_id: int) -> RobotCommand:
    """Command that continues the motion of `old` at constant acceleration, for a tick
    of 1 ms in which no command arrives.

    Source: the client library's `rate_limiting.h` on lost packets.
    """
    rates = old.joints.velocity + TICK * old.joints.acceleration
    twist = old.tool.velocity + TICK * old.tool.acceleration
    return RobotCommand(
        message_id=message_id,
        q=old.q + TICK * rates,
        dq=rates,
        pose=_advance_pose(old.pose, twist),
        twist=twist,
        elbow=None,
        finished=False,
    )


def _joint_position(old: Posture, command: RobotCommand, tool: Array) -> Posture:
    return _joints(old, command.q, (command.q - old.q) / TICK, tool)


def _joint_velocity(old: Posture, command: RobotCommand, tool: Array) -> Posture:
    return _joints(old, old.q + TICK * command.dq, command.dq, tool)


def _joints(old: Posture, q: Array, velocity: Array, tool: Array) -> Posture:
    """Posture one tick of 1 ms after `old` at joints `q` (7,) [rad]; raises Violation
    where a joint breaks a limit.
    """
    rates = old.joints.step(velocity)
    check_joints(old.joints, rates, JOINT)
    return old.move_on(q, tool, rates)


def _cartesian_pose(old: Posture, command: RobotCommand, tool: Array) -> Posture:
    if not rigid(command.pose):
        raise Violation(Reflex.CARTESIAN_POSITION_MOTION_GENERATOR_INVALID_FRAME)
    return _cartesian(
        old, command, command.pose, twist=twist_of(old.pose, command.pose), tool=tool
    )


def _cartesian_velocity(old: Posture, command: RobotCommand, tool: Array) -> Posture:
    return _cartesian(
        old,
        command,
        pose=_advance_pose(old.pose, command.twist),
        twist=command.twist,
        tool=tool,
    )


def _cartesian(
    old: Posture, command: RobotCommand, pose: Array, twist: Array, tool: Array
) -> Posture:
    """Posture one tick of 1 ms after `old`, at tool `pose` (4, 4) and `twist` (6,)
    [m/s, rad/s]; raises Violation where a limit is broken.
    """
    rates = old.tool.step(twist)
    check_tool_rates(old.tool, rates)
    swing = old.swing_to(_elbow(old, command))
    check_swing(old.swing, swing)
    velocity = (
        joint_step(
            old.q, old.reached, jac=old.jacobian, target=pose, elbow=float(swing[0])
        )
        / TICK
    )
    q = old.q + TICK * velocity
    joints = old.joints.step(velocity)
    check_joints(old.joints, joints, CARTESIAN_JOINT)
    return Posture.at_joints(q, tool, joints).with_command(pose, rates, swing)


def _elbow(old: Posture, command: RobotCommand) -> float:
    """Elbow angle [rad] that `command` states, or that of `old` where it states none;
    raises Violation if the elbow would flip.
    """
    if command.elbow is None:
        return old.elbow
    angle, sign = command.elbow
    if sign != old.elbow_sign:
        raise Violation(Reflex.CARTESIAN_MOTION_GENERATOR_ELBOW_SIGN_INCONSISTENT)
    return angle


def _advance_pose(pose: Array, twist: Array) -> Array:
    """Pose (4, 4) to which `twist` (6,) [m/s, rad/s] takes `pose` (4, 4) in one tick of
    1 ms.
    """
    advanced = np.array(pose)
    advanced[:3, 3] += TICK * twist[:3]
    advanced[:3, :3] = rotation(TICK * twist[3:]) @ pose[:3, :3]
    return advanced


_FOLLOW: dict[Generator, Follow] = {
    Generator.JOINT_POSITION: _joint_position,
    Generator.JOINT_VELOCITY: _joint_velocity,
    Generator.CARTESIAN_POSE: _cartesian_pose,
    Generator.CARTESIAN_VELOCITY: _cartesian_velocity,
}
_READ: dict[Generator, Callable[[RobotCommand], Array]] = {
    Generator.JOINT_POSITION: lambda command: command.q,
    Generator.JOINT_VELOCITY: lambda command: command.dq,
    Generator.CARTESIAN_POSE: lambda command: command.pose,
    Generator.CARTESIAN_VELOCITY: lambda command: command.twist,
}
# errors of a first command that does not continue the arm's own posture, whatever limit
# it breaks
_START = {
    Generator.JOINT_POSITION: Reflex.JOINT_POSITION_MOTION_GENERATOR_START_POSE_INVALID,
    Generator.CARTESIAN_POSE: (
        Reflex.CARTESIAN_POSITION_MOTION_GENERATOR_START_POSE_INVALID
    ),
}
_NOT_START_ERRORS = {  # errors that a first command reports by their own name
    Reflex.CARTESIAN_POSITION_MOTION_GENERATOR_INVALID_FRAME,
    Reflex.CARTESIAN_MOTION_GENERATOR_ELBOW_LIMIT_VIOLATION,
    Reflex.CARTESIAN_MOTION_GENERATOR_ELBOW_SIGN_INCONSISTENT,
}
