"""Requests to a robot outside the strip's plane: a motion to given joints, or its pose."""

from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from drivers.arm.joint_motion import follow_joints
from drivers.arm.obstacles import clear_way, solids_of
from drivers.arm.process import (
    END_PATIENCE,
    Task,
    TerminationFlag,
    fault_sent,
    receive,
    schedule,
    send,
)
from drivers.arm.retreat import retreat
from drivers.child import Child

REQUEST_TIMEOUT = 180.0  # s for a request
REST_RATE = 0.01  # rad/s of a joint that stands, the noise of its measurement included


@dataclass(frozen=True, slots=True)
class GoTo:
    """Request for a motion, with the arguments of `go_to`."""

    joints: list[float]
    share: float
    recover: bool
    reset_tool: bool


def go_to(
    task: Task,
    joints: list[float],
    share: float,
    *,
    recover: bool = False,
    reset_tool: bool = False,
) -> None:
    """Bring the robot to `joints` (7,) [rad] at a `share` of full speed and wait; raises Fault.

    With `recover` it is asked to leave its reflex first, and retreats from what presses on it; with
    `reset_tool` it is given the cell's tool, which is read back. Where the straight way meets the
    arm itself, desk, clamp or floor, it goes around. Interrupting this ends the motion.
    """
    _ask(task, GoTo(joints, share, recover, reset_tool))


def hand_pose(task: Task) -> list[float]:
    """Pose of the hand in the robot's base, 16 numbers by columns; moves nothing.

    Raises Fault, for a tool too that is not the cell's.
    """
    return _ask(task, None)


def _ask(task: Task, request: GoTo | None) -> list[float]:
    """Run `request` in a process and return its answer; the robot brakes if the cell dies."""
    child = Child(carry_out, task, request)
    try:
        answer: list[float] = receive(child, REQUEST_TIMEOUT)
        return answer
    finally:
        child.close(END_PATIENCE)


def carry_out(pipe: Connection, task: Task, request: GoTo | None) -> None:
    """Connect to the robot and send its pose (16,), or its joints (7,) [rad] after `request`."""
    with fault_sent(pipe):
        from drivers.arm.robot import Robot

        robot = Robot(task.address, task.settings)
        schedule(task.settings.realtime)
        if request is None:
            robot.require_tool()
            send(pipe, list(robot.state().O_T_EE))
        else:
            send(pipe, _go(robot, task, request, pipe))


def _go(robot: Any, task: Task, request: GoTo, pipe: Connection) -> list[float]:
    """Prepare the robot as `request` asks, check it and bring it to the joints (7,) [rad]."""
    if request.recover:
        robot.recover()
    robot.require_ready()
    if request.reset_tool:
        robot.reset_tool()
    robot.require_tool()
    termination, solids = TerminationFlag(), solids_of(task.installation)

    def interrupted() -> bool:
        return termination.is_set or pipe.poll()

    if request.recover:
        retreat(robot, task.settings, interrupted, solids)
    robot.configure(task.settings.collision)
    guard, reached = robot.guard(), list(robot.state().q)
    way = clear_way(np.array(reached), np.array(request.joints), solids)
    for joints in way:
        if not interrupted():
            guard = robot.guard() if _rests(robot.state()) else guard
            reached = follow_joints(robot, joints.tolist(), request.share, guard, interrupted)
    termination.check()
    return reached


def _rests(state: Any) -> bool:
    """Whether all joints stand, so that the force in `state` can be the tare of this posture."""
    return bool(max(abs(rate) for rate in state.dq) < REST_RATE)
