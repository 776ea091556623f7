"""Driver of a Franka arm that moves the gripper's point and pitch in the plane of the
strip.
"""

from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

import numpy as np

from drivers.base.child import Child
from drivers.base.errors import Fault
from drivers.base.motion import TICK
from drivers.base.protocols import Clock
from drivers.base.types import ArmState, Array, Pose, Velocity, frozen
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.joint_log import joint_rows
from drivers.franka.loop import Close, Ended, RunUntil, run_loop
from drivers.franka.mailbox import CommandKind, LoopCommand, Mailbox, Report
from drivers.franka.process import END_PATIENCE, RobotAccess, receive

SOURCE = "fci arm"
TICK_ROUNDING = 1e-6  # of a tick, between the clock's time and a multiple of ticks
LOG_PATIENCE = 20.0  # s for the log of the joints, which is sent once the arm rests
# in lock-step: many ticks take a busy machine longer than an answer may
TICKS_PER_ANSWER = 50


class FciArm:
    """Driver of a Franka arm, whose 1 kHz loop runs in a separate process.

    The process starts when the arm is first connected or held. In lock-step each state
    and each command first advances the robot by a tick for every millisecond of the
    cell's clock, so runs repeat byte for byte; states of a robot on the wall clock are
    stamped on arrival. A process that does not answer within a timeout is killed; after
    a fault every call raises it again.
    """

    def __init__(
        self,
        access: RobotAccess,
        clock: Clock,
        origin: Callable[[], float | None] = lambda: None,
    ) -> None:
        """Create a driver, not yet connected, of the robot of `access`, with stamps of
        `clock`.

        `origin` gives the clock's zero in the system's monotonic time [s], if it has
        one.
        """
        self._access = access
        self._clock = clock
        self._origin = origin
        self._lock_step = access.settings.in_lock_step
        self._command = LoopCommand(
            number=0, kind=CommandKind.HOLD, beat=0, x=0.0, z=0.0, pitch=0.0
        )
        self._child: Child | None = None
        self._fault: ArmFault | None = None
        self._connected = self._closed = False
        self._start_time = 0.0
        self._ticks = 0
        self._timing: dict[str, Any] = {}
        self._joints = joint_rows(b"")

    def connect(self) -> None:
        """Connect to the arm and hold it at rest; may be called again, raises Fault
        once closed.
        """
        self.hold()
        self._connected = True

    def hold(self) -> None:
        """Hold the arm at its present pose; raises Fault `arm_closed` after `close`."""
        self._require_open()
        if self._child is not None:
            return

        self._commands = Mailbox(LoopCommand)
        self._reports = Mailbox(Report)
        self._child = Child(
            run_loop, self._access, self._origin(), self._commands, self._reports
        )
        self._commands.close()  # the memory stays mapped
        self._reports.close()

        # after Ctrl-C nobody would end the robot's process later
        with ExitStack() as undo:
            undo.callback(self._child.close, END_PATIENCE)
            self._receive(self._child, self._access.settings.start)
            undo.pop_all()

        self._start_time = self._clock.now()

    def join(self) -> None:
        """Hold the arm; in lock-step also advance its robot and hand to the time of the
        cell's clock.
        """
        self.hold()
        self.catch_up()

    def state(self) -> ArmState:
        """Newest measured state of the arm."""
        self._advance_and_beat()
        report = self._report()
        # the last command has yet to be taken
        waiting = report.number != self._command.number
        return ArmState(
            stamp=self._stamp(report),
            arrival=self._clock.now(),
            source=SOURCE,
            pose=Pose(report.x, report.z, report.pitch),
            velocity=Velocity(report.vx, report.vz, report.pitch_rate),
            commanded=Pose(
                report.x_commanded, report.z_commanded, report.pitch_commanded
            ),
            moving=bool(report.moving) or waiting,
            expired=bool(report.expired) and not waiting,
            force=(report.fx, report.fz),
        )

    def move_to(self, pose: Pose) -> None:
        """Start a motion to rest at `pose`; Fault `outside_workspace` for a pose
        outside of it.
        """
        self._advance_and_beat()
        self._access.installation.workspace.check(pose)
        self._send(CommandKind.MOVE, *pose)

    def set_velocity(self, velocity: Velocity) -> None:
        """Move the gripper at `velocity`; Fault `velocity_refused` for one above the
        limits.
        """
        self._advance_and_beat()
        self._access.installation.limits.check(velocity)
        self._send(CommandKind.FOLLOW, *velocity)

    def stop(self) -> None:
        """Brake the arm to rest within its limits; allowed at any time."""
        if self._connected and not self._closed:
            self._advance_and_beat()
            self._send(CommandKind.HOLD, 0.0, 0.0, 0.0)

    def close(self) -> None:
        """Brake the arm to rest and disconnect from it; may be called again, and after
        a fault.
        """
        child = None if self._closed else self._child
        self._closed = True
        if child is None:
            return
        if self._fault is None:
            with suppress(Fault):
                self._end_loop(child)
        child.close(END_PATIENCE)

    def catch_up(self) -> tuple[float, Pose] | None:
        """Advance the arm to the time of the cell's clock; returns the stamp [s] and
        pose of its newest state, None if unconnected.
        """
        if self._child is None or self._closed:
            return None
        self._advance(self._child)
        report = self._report()
        return self._stamp(report), Pose(report.x, report.z, report.pitch)

    @property
    def timing(self) -> dict[str, object]:
        """Histogram of intervals between the robot's states, once closed; empty in
        lock-step.
        """
        return {} if self._lock_step else self._timing

    @property
    def joints(self) -> Array:
        """Joint log (n, 29) with a row for each of n ticks: time [s], then four
        quantities of the seven joints; empty until closed.
        """
        rows = np.array(self._joints)
        rows[:, 0] += self._start_time if self._lock_step else 0.0
        return frozen(rows)

    def _end_loop(self, child: Child) -> None:
        """Let the control loop brake the arm to rest, and receive its timing and joint
        log.
        """
        child.send(Close())
        while not isinstance(answer := self._receive(child, END_PATIENCE), Ended):
            continue
        self._timing = answer.timing
        self._joints = joint_rows(self._receive(child, LOG_PATIENCE))

    def _require_open(self) -> None:
        if self._closed:
            raise Fault("arm_closed", "the arm was let go; open the cell again")

    def _advance_and_beat(self) -> None:
        """Advance the robot to the clock's time and send the loop a heartbeat of the
        cell.
        """
        self._require_open()
        if self._child is None or not self._connected:
            raise Fault(
                "arm_not_connected", "the arm is not connected; connect it first"
            )
        self._advance(self._child)
        self._command = self._command._replace(beat=self._command.beat + 1)
        self._commands.write(self._command)

    def _advance(self, child: Child) -> None:
        """In lock-step, advance the robot to the clock's time."""
        due_tick = int((self._clock.now() - self._start_time) / TICK + TICK_ROUNDING)
        if not self._lock_step or due_tick <= self._ticks:
            return
        self._check()
        while self._ticks < due_tick:
            tick = min(self._ticks + TICKS_PER_ANSWER, due_tick)
            child.send(RunUntil(tick))
            self._receive(child, self._access.settings.answer)
            self._ticks = tick

    def _send(self, kind: CommandKind, x: float, z: float, pitch: float) -> None:
        """Send the loop a command; `x`, `z`, `pitch` state a pose [m, rad] or a
        velocity.
        """
        self._check()
        number = self._command.number + 1
        beat = self._command.beat + 1
        self._command = LoopCommand(number, kind, beat, x, z, pitch)
        self._commands.write(self._command)

    def _report(self) -> Report:
        """Newest report of the control loop."""
        self._check()
        return self._reports.read()

    def _check(self) -> None:
        """Raise the Fault with which the robot has stopped, if it has."""
        if self._fault is None and self._child is not None and self._child.pipe.poll():
            self._receive(self._child, 0.0)
        if self._fault is not None:
            raise self._fault

    def _receive(self, child: Child, patience: float) -> Any:
        """Next message of the loop's process, which is killed if none comes in
        `patience` [s].
        """
        try:
            return receive(child, patience)
        except ArmFault as fault:
            self._fault = fault
            if fault.cause in (Cause.SILENT, Cause.LOST):
                child.kill()
            raise

    def _stamp(self, report: Report) -> float:
        return (
            self._start_time + report.ticks * TICK
            if self._lock_step
            else report.arrival
        )
