"""What a robot is asked outside the strip's plane: to go home joint by joint, or where it is."""

import signal
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from drivers.arm.failure import Cause, Failed, Failure, decoded, encoded, one_line
from drivers.arm.process import Task
from drivers.arm.scheduling import schedule
from drivers.arm.way import REST, Way

LONGEST = 180.0  # s of an errand


def go_to(task: Task, joints: list[float], share: float, *, recover: bool = False) -> None:
    """Bring the robot to `joints` (7,) [rad] at a `share` of the speed; waits, raises Fault.

    With `recover` it is asked to leave its reflex first. Interrupting this ends the motion.
    """
    _carried_out(task, {"joints": joints, "share": share, "recover": recover})


def hand_pose(task: Task) -> list[float]:
    """Where the hand is, 16 numbers by columns in the robot's base; moves nothing."""
    pose: list[float] = _carried_out(task, {})["pose"]
    return pose


def _carried_out(task: Task, errand: dict[str, Any]) -> dict[str, Any]:
    """The answer of a process that does the errand; when this one leaves, the robot brakes."""
    context = get_context("forkserver")
    pipe, theirs = context.Pipe()
    process = context.Process(target=_run, args=(task, errand, theirs), daemon=True)
    process.start()
    theirs.close()
    try:
        if not pipe.poll(LONGEST):
            raise Failure(Cause.SILENT, f"the errand took more than {LONGEST:.0f} s").fault()
        answer = decoded(pipe.recv_bytes())
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


def _run(task: Task, errand: dict[str, Any], pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        answer = _done(task, errand, pipe)
    except Failed as failed:
        answer = {"failure": failed.failure.content()}
    except Exception as error:  # noqa: BLE001  an edge: told to the cell, and the process ends
        answer = {"failure": Failure(Cause.LOST, one_line(error)).content()}
    try:
        pipe.send_bytes(encoded(answer))
    except OSError:
        return


def _done(task: Task, errand: dict[str, Any], pipe: Connection) -> dict[str, Any]:
    from drivers.arm.robot import Robot

    robot = Robot(task.address, task.settings)
    schedule(task.settings.realtime)
    if not errand:
        return {"pose": list(robot.state().O_T_EE)}
    if errand["recover"]:
        robot.recover()
    robot.require_ready()
    robot.configure(task.settings.collision)
    share, guard = errand["share"], task.settings.guard
    return {"joints": follow_joints(robot, errand["joints"], share, guard, pipe.poll)}


def follow_joints(
    robot: Any, joints: list[float], share: float, guard: float, left: Callable[[], bool]
) -> list[float]:
    """Bring `robot` to `joints` (7,) [rad], or to rest once it is `left`; where it stands then.

    Raises Failed at more than `guard` [N] on the hand.
    """
    motion = robot.start_joints()
    state = robot.read(motion)
    way = Way(state, joints, share)
    while not (way.arrived and _stands(state)):
        if left():
            way.brake()
        robot.write_joints(motion, way.tick())
        state = robot.read(motion)
        way.keep_up(state)
        _feel(state, guard)
    robot.write_joints(motion, list(state.q_d), last=True)
    return list(state.q)


def _stands(state: Any) -> bool:
    """Whether the robot's setpoint stands, but for what one tick takes off smoothly."""
    return bool(max(abs(rate) for rate in state.dq_d) < REST)


def _feel(state: Any, guard: float) -> None:
    force = sum(f * f for f in state.O_F_ext_hat_K[:3]) ** 0.5
    if force > guard:
        raise Failed(Failure(Cause.CONTACT, f"the hand met {force:.1f} N, allowed {guard:.1f} N"))
