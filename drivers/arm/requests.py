"""Requests to a robot outside the strip's plane: a motion to given joints, or its pose."""

import gc
import signal
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from drivers.arm.clear_way import clear_way, solids_of
from drivers.arm.ending import Ending
from drivers.arm.failure import Cause, Failed, Failure, decode, encode, one_line
from drivers.arm.process import Task
from drivers.arm.retreat import retreat
from drivers.arm.scheduling import schedule
from drivers.arm.way import follow_joints

REQUEST_TIMEOUT = 180.0  # s for a request
REST_RATE = 0.01  # rad/s of a joint that stands, the noise of its measurement included


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
    request = {"joints": joints, "share": share, "recover": recover, "reset_tool": reset_tool}
    _run_in_process(task, request)


def hand_pose(task: Task) -> list[float]:
    """Pose of the hand in the robot's base, 16 numbers by columns; moves nothing.

    Raises Fault, for a tool too that is not the cell's.
    """
    pose: list[float] = _run_in_process(task, {})["pose"]
    return pose


def _run_in_process(task: Task, request: dict[str, Any]) -> dict[str, Any]:
    """Run `request` in a process and return its answer; the robot brakes if the cell dies."""
    context = get_context("forkserver")
    pipe, theirs = context.Pipe()
    process = context.Process(target=_process_main, args=(task, request, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        if not pipe.poll(REQUEST_TIMEOUT):
            raise Failure(
                Cause.SILENT, f"the request took more than {REQUEST_TIMEOUT:.0f} s"
            ).fault()
        answer = decode(pipe.recv_bytes())
    except (EOFError, OSError):
        raise Failure(Cause.LOST, "the process of the arm ended by itself").fault() from None
    finally:
        pipe.close()
        process.join(2.0)
        if process.is_alive():
            process.kill()
    if "failure" in answer:
        raise Failure.of(answer["failure"]).fault()
    return answer


def _process_main(task: Task, request: dict[str, Any], pipe: Connection) -> None:
    """Execute `request` in this process and send its answer, or its failure, through `pipe`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.disable()  # a collection takes longer than a robot waits for a command
    try:
        answer = _execute(task, request, pipe)
    except Failed as failed:
        answer = {"failure": failed.failure.content()}
    except Exception as error:  # noqa: BLE001  an edge: reported to the cell, and the process ends
        answer = {"failure": Failure(Cause.LOST, one_line(error)).content()}
    try:
        pipe.send_bytes(encode(answer))
    except OSError:
        return


def _execute(task: Task, request: dict[str, Any], pipe: Connection) -> dict[str, Any]:
    """Connect to the robot and carry out `request`; returns the robot's pose or joints."""
    from drivers.arm.robot import Robot

    robot = Robot(task.address, task.settings)
    schedule(task.settings.realtime)
    if not request:
        robot.require_tool()
        return {"pose": list(robot.state().O_T_EE)}
    return {"joints": _go(robot, task, request, pipe)}


def _go(robot: Any, task: Task, request: dict[str, Any], pipe: Connection) -> list[float]:
    """Prepare the robot as `request` asks, check it and bring it to the joints (7,) [rad]."""
    if request["recover"]:
        robot.recover()
    robot.require_ready()
    if request["reset_tool"]:
        robot.reset_tool()
    robot.require_tool()
    ending, solids = Ending(), solids_of(task.installation)

    def left() -> bool:
        return ending() or pipe.poll()

    if request["recover"]:
        retreat(robot, task.settings, left, solids)
    robot.configure(task.settings.collision)
    guard, reached = robot.guard(), list(robot.state().q)
    way = clear_way(np.array(reached), np.array(request["joints"]), solids)
    for joints in way:
        if not left():
            guard = robot.guard() if _rests(robot.state()) else guard
            reached = follow_joints(robot, joints.tolist(), request["share"], guard, left)
    ending.check()
    return reached


def _rests(state: Any) -> bool:
    """Whether all joints stand, so that the force in `state` can be the tare of this posture."""
    return bool(max(abs(rate) for rate in state.dq) < REST_RATE)
