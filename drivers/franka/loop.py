"""The 1 kHz loop: at each tick a ruckig setpoint from the newest command, sent to the
robot.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees, isfinite
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.base.clock import WallClock
from drivers.base.errors import Fault
from drivers.base.installation import Installation
from drivers.base.motion import TICK, MotionProfile
from drivers.base.types import ZERO_VELOCITY, Pose, Velocity
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.force import DriftMonitor, ForceGuard
from drivers.franka.joint_log import JointLog, Timing
from drivers.franka.joint_motion import HandMotion
from drivers.franka.kinematics import HOME, forward
from drivers.franka.mailbox import (
    CommandInbox,
    CommandKind,
    LoopCommand,
    Mailbox,
    Report,
)
from drivers.franka.plane import LEANING, OUT_OF_PLANE, StripPlane
from drivers.franka.process import RobotAccess, TerminationFlag, connection, send
from drivers.franka.reach import REACTION, ReachGuard

if TYPE_CHECKING:  # it needs the robot's library
    from drivers.franka.robot import Robot

MOST_MISSED_COMMANDS = 20  # commands at most until the robot follows one
TICKS_BETWEEN_CHECKS = 10  # ticks between checks of the motion ahead
VELOCITY_STATES = 8  # states over which the velocity is measured
BRAKING_TICKS = 1500  # of the hand on its way, much more than a stop needs
POLL_INTERVAL = 0.1  # s between checks for the end while no message arrives
BESIDE = 0.02  # m from the strip's plane at which the arm brakes
SLOW_SPEED = 0.01  # m/s and rad/s
CALM_SPEED, CALM_RATE = 1e-3, 5e-3  # m/s and rad/s below which the arm rests


@dataclass(frozen=True, slots=True)
class Ready:
    """Answer of the control loop's process: it has started, or has run all ticks that
    it was allowed.
    """


@dataclass(frozen=True, slots=True)
class RunUntil:
    """Message to the loop's process in lock-step: run all ticks up to number `tick`."""

    tick: int


@dataclass(frozen=True, slots=True)
class Close:
    """Message to the loop's process: brake the arm to rest and end."""


@dataclass(frozen=True, slots=True)
class Ended:
    """Last answer of the loop's process, once the arm rests, with the `timing` of its
    ticks.
    """

    timing: dict[str, Any]


class ServoLoop:
    """Control loop, at 1 kHz, of one motion of the arm in the strip's plane, until
    `end`.

    `step` answers a state of the robot with a setpoint: the next one that comes on the
    robot's clock or, in lock-step, the last one, on the cell's. `ticks` counts the
    steps, `joints` logs them, and `success` is the robot's share of commands received
    in time.
    """

    def __init__(
        self,
        robot: "Robot",
        access: RobotAccess,
        commands: Mailbox[LoopCommand],
        reports: Mailbox[Report],
        now: Callable[[], float],
        touch: ForceGuard,
    ) -> None:
        """Start the servo loop at the arm's present pose; ArmFault for a hand out of
        the plane.

        `now` gives the time [s] at which a state has arrived; `touch` limits the
        external force.
        """
        installation = access.installation
        self._robot = robot
        self._settings = access.settings
        self._lock_step = access.settings.in_lock_step
        self._inbox = CommandInbox(commands)
        self._reports = reports
        self._now = now
        self._touch = touch
        self._drift = DriftMonitor(touch, access.settings.drift, TICK)
        self._ending = False
        self._is_commanded = False  # since the last check of the motion ahead
        self._reason: ArmFault | None = None
        self.ticks = 0
        self.success = 0.0
        self.joints = JointLog()
        self._measured: deque[tuple[float, Pose]] = deque(maxlen=VELOCITY_STATES + 1)
        self._motion = robot.start_joints()
        self._state = robot.read(self._motion)
        self._hand = HandMotion(self._state)
        hand = _hand_at(self._state.q_d)
        self._plane = plane_of(installation, hand).with_offset_of(hand)
        self._profile = MotionProfile(
            installation.limits,
            installation.workspace,
            Pose(*self._plane.to_cell(hand)),
        )
        self._reach = ReachGuard(
            plane=self._plane,
            motion=installation.limits,
            joints=self._state.q,
            limits=access.limits,
        )
        self._wait_until_followed()
        self._publish(self._state)

    def _wait_until_followed(self) -> None:
        """Repeat the present joints until the robot follows commands."""
        for _ in range(MOST_MISSED_COMMANDS):
            self._robot.write_joints(self._motion, self._hand.rest())
            self._receive()
            if self._state.control_command_success_rate > 0:
                break
        if not self._lock_step:
            self._robot.write_joints(self._motion, self._hand.rest())

    def step(self) -> None:
        """Run one tick of the robot's time; raises ArmFault when the robot has
        stopped.
        """
        self._take_command()
        self._prepare()
        if not self._lock_step:
            self._receive()
        self._robot.write_joints(self._motion, self._hand.tick())
        if self._lock_step:
            self._receive()
        self.ticks += 1
        self._check_state(self._state)

    def _prepare(self) -> None:
        """Prepare the hand's next joints, before the state arrives that they answer."""
        ticks = self._hand.ticks_due
        for _ in range(ticks):
            self._profile.tick()
        if ticks:
            self._hand.prepare(self._plane.command(*self._profile.pose))

    def _receive(self) -> None:
        """Wait for the robot's next state, and find the hand there."""
        self._state = self._robot.read(self._motion)
        self._hand.update(self._state)

    def _check_state(self, state: Any) -> None:
        """Report `state`; brake for too high a force or a motion that the arm cannot
        follow.
        """
        self._publish(state)
        self._check_force(state)
        if self._is_commanded or self.ticks % TICKS_BETWEEN_CHECKS == 0:
            self._check_ahead()

    def end(self) -> None:
        """Brake the arm to rest and end its motion; later commands are ignored.

        A robot that loses so many commands that it does not come to rest within
        BRAKING_TICKS is left to its own stop.
        """
        self._ending = True
        self._profile.stop()
        until = self.ticks + BRAKING_TICKS
        while self._profile.moving or not self._hand.at_rest:
            if self.ticks >= until:
                break
            self.step()
        self._robot.write_joints(self._motion, self._hand.rest(), last=True)

    @property
    def halted(self) -> ArmFault | None:
        """Reason why the arm braked finally, once it is at rest; None while it may
        continue.
        """
        return None if self._profile.moving else self._reason

    def _take_command(self) -> None:
        """Apply a new command, unless the arm brakes for good; brake once heartbeats
        stop.
        """
        if self._ending or self._reason is not None:
            return
        command = self._inbox.take(self._hand.seconds)
        silence = self._inbox.silence(self._hand.seconds)
        if command is not None:
            self._apply(command)
        elif silence > self._settings.silence and self._profile.moving:
            self._brake_for_good(
                Cause.CELL_SILENT, f"the cell gave no sign of life for {silence:.2f} s"
            )

    def _apply(self, command: LoopCommand) -> None:
        """Give the motion profile the velocity, pose or stop of `command`; ArmFault if
        refused.
        """
        profile = self._profile
        self._is_commanded = True
        values = command.x, command.z, command.pitch
        try:
            match command.kind:
                case CommandKind.FOLLOW:
                    profile.set_velocity(Velocity(*values))
                case CommandKind.MOVE:
                    profile.move_to(Pose(*values))
                case _:
                    profile.stop()
        except Fault as fault:
            raise ArmFault(Cause.COMMAND, str(fault)) from fault

    def _check_force(self, state: Any) -> None:
        """Brake for an external force in `state` beyond its limit, or one that drifts
        at rest.
        """
        objection = self._touch.objection(state)
        objection = objection or self._drift.objection(
            state, moving=self._profile.moving
        )
        if objection:
            self._brake_for_good(Cause.CONTACT, objection)

    def _check_ahead(self) -> None:
        """Brake where the motion ahead leads to a pose that the arm could not
        follow.
        """
        profile = self._profile
        self._is_commanded = False
        if not profile.moving:
            return
        reason = self._reach.objection(profile.predict(REACTION))
        if reason:
            pose = profile.pose
            self._brake_for_good(
                Cause.REACH, f"{reason} beyond x {pose.x:.3f} m, z {pose.z:.3f} m"
            )

    def _brake_for_good(self, cause: Cause, reason: str) -> None:
        """Brake and ignore later commands, because of `cause`; the first cause is
        kept.
        """
        if self._reason is None:
            self._reason = ArmFault(cause, reason)
            self._profile.stop()

    def _publish(self, state: Any) -> None:
        """Log and report `state`; brake where its pose is not finite or off the
        plane.
        """
        self.success = state.control_command_success_rate
        measured = self._checked_pose(_hand_at(state.q))
        arrival = self._now()
        self._measured.append((state.time.to_sec(), measured))
        self.joints.add(self.ticks * TICK if self._lock_step else arrival, state)
        self._reports.write(self._report(state, measured, arrival))

    def _report(self, state: Any, measured: Pose, arrival: float) -> Report:
        """Report on `state`, which arrived at `arrival` [s] with the gripper at
        `measured`.
        """
        profile = self._profile
        velocity = self._mean_velocity()
        calm = velocity.speed < CALM_SPEED and abs(velocity.pitch_rate) < CALM_RATE
        fields = (
            self.ticks,
            -1 if self._ending else self._inbox.number,
            arrival,
            *measured,
            *velocity,
            *profile.pose,
            *self._plane.force(self._touch.beyond_tare(state)),
            profile.moving or not (self._hand.at_rest and calm),
            profile.expired,
        )
        return Report._make(fields)

    def _checked_pose(self, pose: list[float]) -> Pose:
        """Gripper pose in the cell of the hand's `pose` (16,) in the robot's base.

        Brakes where `pose` is off the plane or not finite; for the latter the last one
        is returned.
        """
        x, z, pitch = self._plane.to_cell(pose)
        measured = Pose(x, z, pitch)
        if not isfinite(x + z + pitch):
            self._brake_for_good(
                Cause.NOT_FINITE, "the robot reported a pose that is not a number"
            )
            measured = self._measured[-1][1] if self._measured else measured

        beside = self._plane.position_in_cell(pose)[1]
        if abs(beside) > BESIDE:
            self._brake_for_good(
                Cause.ASIDE, f"the hand is {1e3 * abs(beside):.0f} mm beside its plane"
            )
        return measured

    def _mean_velocity(self) -> Velocity:
        """Mean velocity over the last VELOCITY_STATES states; 0 before the second."""
        start, first = self._measured[0]
        end, last = self._measured[-1]
        duration = end - start
        if duration <= 0.0:
            return ZERO_VELOCITY
        return Velocity(
            (last.x - first.x) / duration,
            (last.z - first.z) / duration,
            (last.pitch - first.pitch) / duration,
        )


def _warm_up(installation: Installation) -> None:
    """Compute a few ticks without a robot, as first calls take longer than a tick of
    the robot.
    """
    plane = StripPlane(installation.mounting.transform())
    space = installation.workspace
    x, z, pitch = (
        0.5 * (low + high) for low, high in zip(space.low, space.high, strict=True)
    )
    profile = MotionProfile(installation.limits, space, Pose(x, z, pitch))
    guard = ReachGuard(plane, installation.limits, HOME.tolist())
    profile.set_velocity(Velocity(SLOW_SPEED, SLOW_SPEED, SLOW_SPEED))

    for _ in range(TICKS_BETWEEN_CHECKS):
        x, z, pitch = profile.tick()
        plane.command(x, z, pitch)
        guard.objection(profile.predict(REACTION))


def _hand_at(joints: Sequence[float]) -> list[float]:
    """Hand pose in the robot's base, a column-major 4x4 matrix (16,), at `joints` (7,)
    [rad].

    Commanded and measured poses by one kinematics: what a robot states as its hand's
    pose may be another (franky-sim 1.0.4 reports the commanded one as measured).
    """
    columns: list[float] = forward(np.array(joints)).T.ravel().tolist()
    return columns


def plane_of(installation: Installation, pose: list[float]) -> StripPlane:
    """Plane of the strip for a hand turned as at `pose` (16,); ArmFault if the hand is
    off it.
    """
    frame = installation.mounting.transform()
    planes = [StripPlane(frame, turned=turned) for turned in (False, True)]
    plane = min(planes, key=lambda candidate: candidate.aside(pose)[1])
    beside, leaning = plane.aside(pose)
    if beside > OUT_OF_PLANE or leaning > LEANING:
        raise ArmFault(
            Cause.PLACE,
            f"the hand stands {1e3 * beside:.0f} mm beside the strip's plane and leans"
            f" {degrees(leaning):.1f} deg out of it, allowed {1e3 * OUT_OF_PLANE:.0f}"
            f" mm and {degrees(LEANING):.1f} deg",
        )
    return plane


def run_loop(
    pipe: Connection,
    access: RobotAccess,
    origin: float | None,
    commands: Mailbox[LoopCommand],
    reports: Mailbox[Report],
) -> None:
    """Run a robot's loop until the cell at the other end of `pipe` ends, or the robot
    stops.

    At the end it sends timing and joints, stamped by the monotonic clock from its
    `origin` [s], or else the ArmFault that ended the motion.
    """
    _warm_up(access.installation)
    timing = Timing()
    with connection(pipe, access) as robot:
        robot.require_ready()
        robot.require_tool()
        robot.configure(access.settings.collision)
        clock = WallClock(origin)
        termination = TerminationFlag()
        loop = ServoLoop(
            robot=robot,
            access=access,
            commands=commands,
            reports=reports,
            now=clock.now,
            touch=robot.tared_guard(),
        )
        send(pipe, Ready())
        if access.settings.in_lock_step:
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
        send(pipe, loop.joints.content())


def _run_in_lock_step(
    loop: ServoLoop, pipe: Connection, termination: TerminationFlag
) -> None:
    """Step the loop as far as the cell allows and confirm, until the cell closes or is
    gone.
    """
    while isinstance(message := _receive(pipe, termination), RunUntil):
        while loop.ticks < message.tick:
            loop.step()
            if loop.halted is not None:
                return
        send(pipe, Ready())


def _receive(pipe: Connection, termination: TerminationFlag) -> RunUntil | Close | None:
    """Message from the cell; None where the cell has gone or this process is to end."""
    try:
        while not pipe.poll(POLL_INTERVAL):
            if termination.is_set:
                return None
        message: RunUntil | Close = pipe.recv()
    except (EOFError, OSError):
        return None
    return None if termination.is_set else message
