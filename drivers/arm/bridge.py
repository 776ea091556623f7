"""Connection to the process that runs the robot's 1 kHz loop, and that process itself."""

from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from drivers.arm.failure import ArmFault, Cause
from drivers.arm.joint_log import JointLog, Timing, joint_rows
from drivers.arm.joint_motion import CartesianMotion
from drivers.arm.loop import ServoLoop, warm_up
from drivers.arm.mailbox import CommandKind, LoopCommand, Mailbox, Report
from drivers.arm.process import (
    END_PATIENCE,
    Task,
    TerminationFlag,
    apply_realtime,
    fault_sent,
    receive,
    send,
)
from drivers.arm.robot import Robot
from drivers.child import Child
from drivers.clock import WallClock
from drivers.errors import Fault

LOG_PATIENCE = 20.0  # s for the log of the joints, which is sent once the arm rests
TICKS_PER_ANSWER = 50  # in lock-step: many ticks take a busy machine longer than an answer may
POLL_INTERVAL = 0.1  # s between checks for the end while no message arrives


@dataclass(frozen=True, slots=True)
class Ready:
    """Answer: the loop runs, or has run the ticks that the cell allowed."""


@dataclass(frozen=True, slots=True)
class RunUntil:
    """Message to a loop in lock-step: run the ticks up to this number."""

    tick: int


@dataclass(frozen=True, slots=True)
class Close:
    """Message to the loop: come to rest and end."""


@dataclass(frozen=True, slots=True)
class Ended:
    """Answer: the arm rests; with the histogram of the loop's timing."""

    timing: dict[str, Any]


class Bridge:
    """Connection to a process that runs the loop of one robot; every wait has a timeout.

    A process that does not answer is killed. After a fault every call raises it again.
    """

    def __init__(self, task: Task) -> None:
        """Start the process and wait until it controls the robot; raises Fault where that fails."""
        self._task = task
        self._commands, self._reports = Mailbox(LoopCommand), Mailbox(Report)
        self._command = LoopCommand(0, CommandKind.HOLD, 0, 0.0, 0.0, 0.0)
        self._fault: ArmFault | None = None
        self._ended = False
        self.ticks = 0
        self.timing: dict[str, Any] = {}
        self.joints = joint_rows(b"")
        self._child = Child(run_loop, task, self._commands, self._reports)
        self._commands.close()  # the memory stays mapped
        self._reports.close()
        try:
            self._receive(task.settings.start)
        except BaseException:  # Ctrl-C too: nobody would end the robot's process later
            self._child.close(END_PATIENCE)
            raise

    @property
    def lock_step(self) -> bool:
        """Whether the cell drives the robot's time."""
        return self._task.lock_step

    @property
    def process(self) -> int:
        """Process ID of the process that owns the robot."""
        return self._child.pid

    def command(
        self, kind: CommandKind, x: float = 0.0, z: float = 0.0, pitch: float = 0.0
    ) -> None:
        """Replace the command that the loop follows."""
        self.check()
        last = self._command
        self._command = LoopCommand(last.number + 1, kind, last.beat + 1, x, z, pitch)
        self._commands.write(self._command)

    def beat(self) -> None:
        """Send a heartbeat, by which the loop knows that the cell runs."""
        self._command = self._command._replace(beat=self._command.beat + 1)
        self._commands.write(self._command)

    def advance(self, until: int) -> None:
        """In lock-step, run all ticks of the robot up to number `until`."""
        self.check()
        first = self.ticks + TICKS_PER_ANSWER
        for tick in (*range(first, until, TICKS_PER_ANSWER), until):
            self._child.send(RunUntil(tick))
            self._receive(self._task.settings.answer)
            self.ticks = tick

    def report(self) -> tuple[Report, bool]:
        """Newest report of the control loop, and whether it has yet to take the last command."""
        self.check()
        report = self._reports.read()
        return report, report.number != self._command.number

    def check(self) -> None:
        """Raise the Fault with which the robot has stopped, if it has."""
        if self._fault is None and not self._ended and self._child.pipe.poll():
            self._receive(0.0)
        if self._fault is not None:
            raise self._fault

    def close(self) -> None:
        """Bring the arm to rest and end the process; allowed twice and after a fault."""
        if self._ended:
            return
        self._ended = True
        if self._fault is None:
            with suppress(Fault):
                self._child.send(Close())
                while not isinstance(answer := self._receive(END_PATIENCE), Ended):
                    continue
                self.timing = answer.timing
                self.joints = joint_rows(self._receive(LOG_PATIENCE))
        self._child.close(END_PATIENCE)

    def _receive(self, patience: float) -> Any:
        """One answer of the process within `patience` [s]; a process that gives none is killed."""
        try:
            return receive(self._child, patience)
        except ArmFault as fault:
            self._fault = fault
            if fault.cause in (Cause.SILENT, Cause.LOST):
                self._child.kill()
            raise


def run_loop(
    pipe: Connection, task: Task, commands: Mailbox[LoopCommand], reports: Mailbox[Report]
) -> None:
    """Run a robot's loop until the cell at the other end of `pipe` closes or dies, or it stops."""
    with fault_sent(pipe):
        _run_loop(pipe, task, commands, reports)


def _run_loop(
    pipe: Connection, task: Task, commands: Mailbox[LoopCommand], reports: Mailbox[Report]
) -> None:
    """Connect to the robot, run its loop to the end, then send timing and joints."""
    clock = WallClock(task.origin)
    warm_up(task.installation)
    robot = Robot(task.address, task.settings)
    apply_realtime(task.settings.realtime)
    robot.require_ready()
    robot.require_tool()
    robot.configure(task.settings.collision)
    joints, timing = JointLog(), Timing()
    loop = ServoLoop(
        CartesianMotion(robot, own_clock=not task.lock_step),
        task.settings,
        task.installation,
        commands,
        reports,
        clock.now,
        lock_step=task.lock_step,
        guard=robot.guard(),
        joints=joints,
    )
    termination = TerminationFlag()
    loop.begin()
    send(pipe, Ready())
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
    send(pipe, Ended(timing.content()))
    send(pipe, joints.content())


def _run_in_lock_step(loop: ServoLoop, pipe: Connection, termination: TerminationFlag) -> None:
    """Step the loop as far as the cell allows and confirm, until the cell closes or dies."""
    while isinstance(message := _receive(pipe, termination), RunUntil):
        while loop.ticks < message.tick:
            loop.step()
            if loop.halted is not None:
                return
        send(pipe, Ready())


def _receive(pipe: Connection, termination: TerminationFlag) -> RunUntil | Close | None:
    """The cell's next message; None where the cell has gone or this process is to end."""
    try:
        while not pipe.poll(POLL_INTERVAL):
            if termination.is_set:
                return None
        message: RunUntil | Close = pipe.recv()
    except (EOFError, OSError):
        return None
    return None if termination.is_set else message
