"""Connection to the process that runs the robot's 1 kHz loop, and that process itself."""

import json
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from drivers.arm.failure import ArmFault, Cause
from drivers.arm.joint_log import JointLog, Timing, joint_rows
from drivers.arm.joint_motion import CartesianMotion
from drivers.arm.loop import Loop, rehearse
from drivers.arm.orders import Kind, Latest, Order, Report
from drivers.arm.process import RobotProcess, Task, TerminationFlag, schedule, send
from drivers.arm.robot import Robot
from drivers.clock import WallClock
from drivers.errors import Fault

END_PATIENCE = 1.5  # s for the arm to come to rest
LOG_PATIENCE = 20.0  # s for the log of the joints, which is sent once the arm rests
TICKS_PER_ANSWER = 50  # in lock-step: many ticks take a busy machine longer than an answer may
BETWEEN_LOOKS = 0.1  # s between looks, where no message comes, whether to end


class Bridge:
    """Connection to a process that runs the loop of one robot; every wait has a timeout.

    A process that does not answer is killed. After a fault every call raises it again.
    """

    def __init__(self, task: Task) -> None:
        """Start the process and wait until it controls the robot; raises Fault where that fails."""
        context = get_context("forkserver")
        orders, reports = (Latest.allocate(kind, context) for kind in (Order, Report))
        self._task = task
        self._orders, self._reports = Latest(orders, Order), Latest(reports, Report)
        self._order = Order(0, Kind.HOLD, 0, 0.0, 0.0, 0.0)
        self._fault: ArmFault | None = None
        self._ended = False
        self.ticks = 0
        self.timing: dict[str, Any] = {}
        self.joints = joint_rows(b"")
        self._process = RobotProcess(run_loop, task, orders, reports)
        self._receive(task.settings.start)

    @property
    def lock_step(self) -> bool:
        """Whether the cell drives the robot's time."""
        return self._task.lock_step

    @property
    def process(self) -> int | None:
        """Process ID of the process that owns the robot."""
        return self._process.id

    def order(self, kind: Kind, a: float = 0.0, b: float = 0.0, c: float = 0.0) -> None:
        """Replace the command that the loop follows."""
        self.check()
        last = self._order
        self._order = Order(last.number + 1, kind, last.beat + 1, a, b, c)
        self._orders.write(self._order)

    def beat(self) -> None:
        """Send a heartbeat, by which the loop knows that the cell runs."""
        self._order = self._order._replace(beat=self._order.beat + 1)
        self._orders.write(self._order)

    def advance(self, until: int) -> None:
        """In lock-step, run all ticks of the robot up to number `until`."""
        self.check()
        first = self.ticks + TICKS_PER_ANSWER
        for tick in (*range(first, until, TICKS_PER_ANSWER), until):
            send(self._process.pipe, {"until": tick})
            self._receive(self._task.settings.answer)
            self.ticks = tick

    def report(self) -> tuple[Report, bool]:
        """Newest report of the control loop, and whether it has yet to take the last command."""
        self.check()
        report = self._reports.read()
        return report, report.number != self._order.number

    def check(self) -> None:
        """Raise the Fault with which the robot has stopped, if it has."""
        if self._fault is None and not self._ended and self._process.pipe.poll():
            self._receive(0.0)
        if self._fault is not None:
            raise self._fault

    def close(self) -> None:
        """Bring the arm to rest and end the process; allowed twice and after a fault."""
        if self._ended:
            return
        self._ended = True
        if self._fault is None:
            with suppress(OSError, EOFError, Fault):
                send(self._process.pipe, {"close": True})
                while not self.timing:
                    self.timing = self._receive(END_PATIENCE).get("timing", {})
                if self._process.pipe.poll(LOG_PATIENCE):
                    self.joints = joint_rows(self._process.pipe.recv_bytes())
        self._process.end()

    def _receive(self, patience: float) -> dict[str, Any]:
        """One answer of the process within `patience` [s]; a process that gives none is killed."""
        try:
            return self._process.receive(patience)
        except ArmFault as fault:
            self._fault = fault
            if fault.cause in (Cause.SILENT, Cause.LOST):
                self._process.kill()
            raise


def run_loop(pipe: Connection, task: Task, orders: Any, reports: Any) -> None:
    """Run a robot's loop until the cell at the other end of `pipe` closes or dies, or it stops.

    Timing and joints are sent at its end. Raises ArmFault where the robot has stopped.
    """
    clock = WallClock(task.origin)
    rehearse(task.installation)
    robot = Robot(task.address, task.settings)
    schedule(task.settings.realtime)
    robot.require_ready()
    robot.require_tool()
    robot.configure(task.settings.collision)
    joints, timing = JointLog(), Timing()
    loop = Loop(
        CartesianMotion(robot, own_clock=not task.lock_step),
        task.settings,
        task.installation,
        Latest(orders, Order),
        Latest(reports, Report),
        clock.now,
        lock_step=task.lock_step,
        guard=robot.guard(),
        joints=joints,
    )
    termination = TerminationFlag()
    loop.begin()
    send(pipe, {"ready": True})
    if task.lock_step:
        _run_in_lock_step(loop, pipe, termination)
    else:
        while loop.halted is None and not pipe.poll() and not termination.is_set:
            loop.step()
            timing.update(clock.now(), loop.success)
    loop.end()
    if loop.halted is not None:
        raise loop.halted
    termination.check()
    send(pipe, {"timing": timing.content()})
    with suppress(OSError):
        pipe.send_bytes(joints.content())


def _run_in_lock_step(loop: Loop, pipe: Connection, termination: TerminationFlag) -> None:
    """Step the loop as far as the cell allows and confirm, until the cell closes or dies."""
    while (message := _receive(pipe, termination)) is not None and "until" in message:
        while loop.ticks < message["until"]:
            loop.step()
            if loop.halted is not None:
                return
        send(pipe, {})


def _receive(pipe: Connection, termination: TerminationFlag) -> dict[str, Any] | None:
    """The cell's next message; None where the cell has gone or this process is to end."""
    try:
        while not pipe.poll(BETWEEN_LOOKS):
            if termination.is_set:
                return None
        message: dict[str, Any] = json.loads(pipe.recv_bytes())
    except (EOFError, OSError):
        return None
    return None if termination.is_set else message
