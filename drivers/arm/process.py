"""The process that owns the connection to the robot, and whose end ends the motion."""

import gc
import signal
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from drivers.arm.by_joints import ByJoints
from drivers.arm.ending import Ending
from drivers.arm.failure import Cause, Failed, Failure, decode, encode, one_line
from drivers.arm.joint_log import JointLog, Timing
from drivers.arm.latest import Latest
from drivers.arm.loop import Loop, rehearse
from drivers.arm.messages import ORDER_LAYOUT, REPORT_LAYOUT, Order, Report
from drivers.arm.robot import Robot
from drivers.arm.scheduling import schedule
from drivers.arm.settings import FciSettings
from drivers.clock import WallClock
from drivers.installation import Installation

BETWEEN_LOOKS = 0.1  # s between looks, where no message comes, whether to end


@dataclass(frozen=True, slots=True)
class Task:
    """Arguments of the process that owns the robot, with the `origin` of the clock it shares."""

    address: str
    settings: FciSettings
    installation: Installation
    origin: float | None

    @property
    def lock_step(self) -> bool:
        """Whether the cell drives the robot's time."""
        return self.origin is None


def run(task: Task, pipe: Connection, orders: Any, reports: Any) -> None:
    """Serve the cell at the other end of `pipe` until it closes or dies, or the robot stops."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the cell decides when the arm stops
    gc.disable()  # nothing here makes cycles, and a collection takes longer than a tick
    try:
        _serve(task, pipe, orders, reports)
    except Failed as failed:
        _send_failure(pipe, failed.failure)
    except Exception as error:  # noqa: BLE001  an edge: the process ends, and with it the motion
        _send_failure(pipe, Failure(Cause.LOST, one_line(error)))


def _serve(task: Task, pipe: Connection, orders: Any, reports: Any) -> None:
    """Connect to the robot, run its loop to the end, send timing and joints through `pipe`."""
    clock = WallClock(task.origin)
    rehearse(task.installation)
    robot = Robot(task.address, task.settings)
    schedule(task.settings.realtime)
    robot.require_ready()
    robot.require_tool()
    robot.configure(task.settings.collision)
    joints = JointLog()
    loop = Loop(
        ByJoints(robot, own_clock=not task.lock_step),
        task.settings,
        task.installation,
        Latest(orders, Order, ORDER_LAYOUT),
        Latest(reports, Report, REPORT_LAYOUT),
        clock.now,
        lock_step=task.lock_step,
        guard=robot.guard(),
        joints=joints,
    )
    ending = Ending()
    loop.begin()
    pipe.send_bytes(encode({"ready": True}))
    drive = _run_in_lock_step if task.lock_step else _run_in_real_time
    timing = Timing()
    drive(loop, pipe, timing, clock, ending)
    loop.end()
    if loop.halted is not None:
        raise Failed(loop.halted)
    ending.check()
    pipe.send_bytes(encode({"ended": True, "timing": timing.content()}))
    pipe.send_bytes(joints.content())


def _run_in_lock_step(
    loop: Loop, pipe: Connection, _timing: Timing, _clock: WallClock, ending: Ending
) -> None:
    """Step the loop as far as the cell allows and confirm, until the cell closes or dies."""
    while (message := _receive(pipe, ending)) is not None and "until" in message:
        while loop.ticks < message["until"]:
            loop.step()
            if loop.halted is not None:
                return
        pipe.send_bytes(b"{}")


def _run_in_real_time(
    loop: Loop, pipe: Connection, timing: Timing, clock: WallClock, ending: Ending
) -> None:
    """Step the loop on the robot's clock until the cell closes or dies."""
    while loop.halted is None and not pipe.poll() and not ending():
        loop.step()
        timing.update(clock.now(), loop.success)


def _receive(pipe: Connection, ending: Ending) -> dict[str, Any] | None:
    """The cell's next message; None where the cell has gone or this process is to end."""
    try:
        while not pipe.poll(BETWEEN_LOOKS):
            if ending():
                return None
        return None if ending() else decode(pipe.recv_bytes())
    except (EOFError, OSError):
        return None


def _send_failure(pipe: Connection, failure: Failure) -> None:
    try:
        pipe.send_bytes(encode({"failure": failure.content()}))
    except OSError:
        return
