"""Arm driver of the cell: a Franka arm as a gripper point in the plane of the strip."""

from collections.abc import Callable

import numpy as np

from drivers.arm.bridge import Bridge
from drivers.arm.joint_log import joint_rows
from drivers.arm.mailbox import CommandKind, Report
from drivers.errors import Fault
from drivers.installation import Installation
from drivers.motion import TICK
from drivers.protocols import Clock
from drivers.types import ArmState, Array, Pose, Velocity, frozen

SOURCE = "fci arm"
TICK_ROUNDING = 1e-6  # of a tick, between the clock's time and a multiple of ticks


class FciArm:
    """Driver of a Franka arm, whose 1 kHz loop runs in a separate process.

    In lock-step the robot makes one tick for each millisecond of the cell's clock whenever the cell
    reads its state or sends a command, so runs repeat byte for byte. States of a robot that follows
    the wall clock are stamped on arrival.
    """

    def __init__(
        self, start: Callable[[], Bridge], clock: Clock, installation: Installation
    ) -> None:
        """Drive an arm on `clock`; `start` starts the process that connects to the robot."""
        self._start = start
        self._clock = clock
        self._installation = installation
        self._bridge: Bridge | None = None
        self._start_time = 0.0
        self._connected = False
        self._closed = False

    def connect(self) -> None:
        """Connect and hold the arm at rest; allowed twice, refused with a Fault once closed."""
        self.hold()
        self._connected = True

    def hold(self) -> None:
        """Hold the arm at its present pose; raises Fault `arm_closed` after `close`."""
        if self._closed:
            raise Fault("arm_closed", "the arm was let go; open the cell again")
        if self._bridge is None:
            self._bridge = self._start()
            self._start_time = self._clock.now()

    def join(self) -> None:
        """Hold the arm and advance it to the clock's time, for devices that follow its robot."""
        self.hold()
        self.catch_up()

    def state(self) -> ArmState:
        """The newest measured state of the arm."""
        report, waiting = self._caught_up().report()
        return ArmState(
            stamp=self._stamp(report),
            arrival=self._clock.now(),
            source=SOURCE,
            pose=Pose(report.x, report.z, report.pitch),
            velocity=Velocity(report.vx, report.vz, report.pitch_rate),
            commanded=Pose(report.x_commanded, report.z_commanded, report.pitch_commanded),
            moving=bool(report.moving) or waiting,
            expired=bool(report.expired) and not waiting,
            force=(report.fx, report.fz),
        )

    def move_to(self, pose: Pose) -> None:
        """Start a motion to rest at `pose`; Fault `outside_workspace` when it is out of reach."""
        bridge = self._caught_up()
        self._installation.workspace.check(pose)
        bridge.command(CommandKind.MOVE, pose.x, pose.z, pose.pitch)

    def set_velocity(self, velocity: Velocity) -> None:
        """Follow `velocity`; Fault `velocity_refused` above the limits."""
        bridge = self._caught_up()
        self._installation.limits.check(velocity)
        bridge.command(CommandKind.FOLLOW, velocity.vx, velocity.vz, velocity.pitch_rate)

    def stop(self) -> None:
        """Brake within the limits; allowed at any time, from any state."""
        if self._connected and not self._closed:
            self._caught_up().command(CommandKind.HOLD)

    def close(self) -> None:
        """Brake and disconnect; calling it twice is allowed."""
        self._closed = True
        if self._bridge is not None:
            self._bridge.close()

    def catch_up(self) -> tuple[float, Pose] | None:
        """Advance the arm to the clock's time; returns stamp [s] and pose, None if unconnected."""
        if self._bridge is None or self._closed:
            return None
        self._advance(self._bridge)
        report, _ = self._bridge.report()
        return self._stamp(report), Pose(report.x, report.z, report.pitch)

    @property
    def process(self) -> int | None:
        """Process ID of the process that owns the robot; None before the first use."""
        return None if self._bridge is None else self._bridge.process

    @property
    def timing(self) -> dict[str, object]:
        """Histogram of intervals between the robot's states, once closed; empty in lock-step."""
        if self._bridge is None or self._bridge.lock_step:
            return {}
        return self._bridge.timing

    @property
    def joints(self) -> Array:
        """Joint log (n, 29), one row a tick with its time [s] on the clock; empty until closed."""
        if self._bridge is None:
            return joint_rows(b"")
        rows = np.array(self._bridge.joints)
        rows[:, 0] += self._start_time if self._bridge.lock_step else 0.0
        return frozen(rows)

    def _caught_up(self) -> Bridge:
        """Advance the robot to the clock's time and return the bridge to its process."""
        if self._closed:
            raise Fault("arm_closed", "the arm was let go; open the cell again")
        if self._bridge is None or not self._connected:
            raise Fault("arm_not_connected", "the arm is not connected; connect it first")
        self._advance(self._bridge)
        self._bridge.beat()
        return self._bridge

    def _advance(self, bridge: Bridge) -> None:
        """In lock-step, advance the robot to the clock's time."""
        if not bridge.lock_step:
            return
        due = int((self._clock.now() - self._start_time) / TICK + TICK_ROUNDING)
        if due > bridge.ticks:
            bridge.advance(due)

    def _stamp(self, report: Report) -> float:
        lock_step = self._bridge is not None and self._bridge.lock_step
        return self._start_time + report.ticks * TICK if lock_step else report.arrival
