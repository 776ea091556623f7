"""Emulated robot without sockets or clock: its modes, one motion at a time, reflexes,
stops and recovery.

It is stepped in control periods of 1 ms. Its caller requests motions and settings, and
collects the replies that are due only at the end of a motion.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import repeat
from math import isfinite
from typing import Self

import numpy as np

from drivers.base.types import Array
from drivers.franka.collision import Solids
from drivers.franka.inverse_kinematics import manipulability
from drivers.franka.kinematics import HOME
from drivers.franka.limits import PUBLISHED, Revision
from drivers.twin.fci_server.configuration import SETTERS, Configuration, configure
from drivers.twin.fci_server.dynamics import Dynamics, LaggingArm, ReportedRates
from drivers.twin.fci_server.generators import extrapolate, follow, readable
from drivers.twin.fci_server.limits import (
    CARTESIAN_JOINT,
    JOINT,
    BodyCheck,
    Violation,
    check_ends,
    check_tool_position,
)
from drivers.twin.fci_server.posture import Posture
from drivers.twin.fci_server.wire import (
    ClientRequest,
    Command,
    Controller,
    Generator,
    MoveRequest,
    MoveStatus,
    Reflex,
    RobotCommand,
    RobotMode,
    Status,
)

# smallest singular value of a Jacobian from which a Cartesian motion may start
SINGULAR = 0.01
MOST_MISSED_TICKS = 20  # ticks in a row without a command
CARTESIAN = (Generator.CARTESIAN_POSE, Generator.CARTESIAN_VELOCITY)
STEADY_ACCELERATION = 1e-3  # rad/s^2 and m/s^2, below which a motion counts as uniform


@dataclass(frozen=True, slots=True)
class Contact:
    """Estimated external `wrench` (6,) [N, N m] on the tool in the base's frame, and
    the joint torques (7,) [N m] it causes.

    Flags are 1 where a threshold is exceeded: first row for contact, second row for
    collision.
    """

    wrench: Array
    torque: Array  # (7,) N m
    joint_flags: Array  # (2, 7)
    tool_flags: Array  # (2, 6)

    @classmethod
    def of_force(
        cls, posture: Posture, configuration: Configuration, force: Array
    ) -> Self:
        """Contact by a `force` (3,) [N] in the robot's base on the tool's origin in
        `posture`.
        """
        wrench = np.zeros(6)
        wrench[:3] = force
        lever = posture.reached[:3, :3] @ configuration.tool_to_stiffness[:3, 3]
        wrench[3:] = np.cross(-lever, force)
        torque = posture.jacobian[:3].T @ force
        thresholds = configuration.thresholds
        steady = bool((np.abs(posture.joints.acceleration) < STEADY_ACCELERATION).all())
        joints = thresholds.torque_nominal if steady else thresholds.torque_accelerating
        tool = thresholds.force_nominal if steady else thresholds.force_accelerating
        joint_flags = np.greater(np.abs(torque), joints).astype(np.float64)
        tool_flags = np.greater(np.abs(wrench), tool).astype(np.float64)
        return cls(
            wrench=wrench, torque=torque, joint_flags=joint_flags, tool_flags=tool_flags
        )

    @property
    def reflex(self) -> Reflex | None:
        """Reflex that an exceeded collision threshold triggers; None where none is
        exceeded.
        """
        if self.tool_flags[1].any():
            return Reflex.CARTESIAN_REFLEX
        return Reflex.JOINT_REFLEX if self.joint_flags[1].any() else None


NO_CONTACT = Contact(
    wrench=np.zeros(6),
    torque=np.zeros(7),
    joint_flags=np.zeros((2, 7)),
    tool_flags=np.zeros((2, 6)),
)


Push = Callable[[Array, float], Array]
"""Force (3,) [N] in the base on the tool, from its pose (4, 4) and robot time [s]."""


@dataclass(slots=True)
class ActiveMotion:
    """Motion that the emulated robot executes; the reply at its end answers the request
    `command_id`.
    """

    command_id: int
    generator: Generator
    controller: Controller
    started: bool = False
    stopping: bool = False
    missed: int = 0


@dataclass(frozen=True, slots=True)
class LateReply:
    """Reply to a client's request that is sent only at the end of a motion."""

    command: Command
    command_id: int
    status: int


@dataclass(slots=True)
class EmulatedRobot:
    """Emulated robot, advanced in ticks of 1 ms; `time` [ms] counts these, and `ticks`
    the commands that it has tried to follow, also those made up for lost ones.
    """

    posture: Posture
    push: Push | None = None
    body: BodyCheck = field(default_factory=BodyCheck)
    trailing: LaggingArm | None = None
    dynamics: Dynamics | None = None
    configuration: Configuration = field(default_factory=Configuration)
    revision: Revision = "fr3"
    mode: RobotMode = RobotMode.IDLE
    errors: frozenset[Reflex] = frozenset()
    reasons: frozenset[Reflex] = frozenset()
    motion: ActiveMotion | None = None
    contact: Contact = NO_CONTACT
    pushed: Array = field(default_factory=lambda: np.zeros(3))  # N, by the fault script
    sensors_fail_until: float = 0.0  # ms, by the fault script: what they measure is NaN
    reported: ReportedRates = field(default_factory=ReportedRates)
    mistaken: float = 0.0  # share of its own torques that it takes for external ones
    losses: Iterator[bool] = field(default_factory=lambda: repeat(False))
    holds: bool = False  # its joints where no command comes, else their acceleration
    time: int = 0
    ticks: int = 0
    late: list[LateReply] = field(default_factory=list)
    waiting: list[LateReply] = field(default_factory=list)

    @property
    def moving(self) -> bool:
        """Whether a motion is in progress that accepts commands; False while the arm
        brakes.
        """
        return self.motion is not None and not self.motion.stopping

    @property
    def measured(self) -> Posture:
        """Posture of the emulated arm as it is, which may lag behind its
        commanded one.
        """
        return self.posture if self.trailing is None else self.trailing.posture

    def move(self, request: MoveRequest, command_id: int) -> MoveStatus:
        """Start the motion in `request`; returns MOTION_STARTED, or the status that
        says why it is refused.
        """
        if (
            self.mode is not RobotMode.IDLE
            or self.motion is not None
            or not self.posture.at_rest
        ):
            return MoveStatus.NOT_POSSIBLE

        numbered = request.controller in range(3) and request.generator in range(5)
        if not numbered or not all(
            isfinite(part) and part >= 0 for part in request.deviations
        ):
            return MoveStatus.INVALID_ARGUMENT

        controller = Controller(request.controller)
        generator = Generator(request.generator + 1)
        if (
            controller is Controller.EXTERNAL
            or generator is Generator.NONE
            or request.use_async
        ):
            return MoveStatus.NOT_POSSIBLE
        if generator in CARTESIAN and manipulability(self.posture.jacobian) < SINGULAR:
            return MoveStatus.SINGULAR_START

        self.motion = ActiveMotion(command_id, generator, controller)
        self.mode = RobotMode.MOVE
        self.reasons = frozenset()
        return MoveStatus.MOTION_STARTED

    def stop(self, command_id: int) -> None:
        """Brake the arm; the reply to request `command_id` is due once the arm is at
        rest.
        """
        self.waiting.append(LateReply(Command.STOP_MOVE, command_id, Status.SUCCESS))
        if self.motion is not None:
            self.motion.stopping = True

    def set(self, request: ClientRequest[Command]) -> Status:
        """Change the setting that `request` states, which only an idle robot
        accepts.
        """
        if request.command not in SETTERS or self.mode is not RobotMode.IDLE:
            return Status.NOT_POSSIBLE
        old = self.configuration
        self.configuration, status = configure(old, request.command, request.payload)
        if request.command is Command.SET_NE_TO_EE:
            self.posture = Posture.resting(self.posture.q, self.configuration.tool)
        return status

    def recover(self, command_id: int) -> Status | None:
        """Recover from a reflex once the arm is at rest; returns None, as the reply to
        request `command_id` follows only then.

        Returns NOT_POSSIBLE in motion or while the user stop is pressed.
        """
        if self.mode not in (RobotMode.IDLE, RobotMode.REFLEX):
            return Status.NOT_POSSIBLE
        self.waiting.append(
            LateReply(Command.AUTOMATIC_ERROR_RECOVERY, command_id, Status.SUCCESS)
        )
        return None

    def reflex(self, error: Reflex) -> None:
        """Abort the motion with `error` and brake; the arm moves again only after
        recovery.
        """
        if self.mode is RobotMode.USER_STOPPED:
            return
        self._finish(MoveStatus.REFLEX_ABORTED)
        self.mode = RobotMode.REFLEX
        self.errors = self.reasons = frozenset({error})

    def press_user_stop(self) -> None:
        """Abort the motion and brake; no motion starts until the user stop is
        released.
        """
        self._finish(MoveStatus.EMERGENCY_ABORTED)
        self.mode = RobotMode.USER_STOPPED

    def release_user_stop(self) -> None:
        """Release the user stop: the robot is idle again, or in its earlier reflex."""
        if self.mode is RobotMode.USER_STOPPED:
            self.mode = RobotMode.REFLEX if self.errors else RobotMode.IDLE

    def abandon(self) -> None:
        """Brake after the client has disconnected, and discard its pending replies."""
        self._finish(MoveStatus.ABORTED)
        self.late.clear()
        self.waiting.clear()

    def receive(self, command: RobotCommand) -> bool:
        """Execute `command` unless the emulated network loses it; returns whether it
        has arrived.
        """
        lost = next(self.losses)
        if lost:
            self.miss()
        else:
            self.step(command)
        return not lost

    def step(self, command: RobotCommand) -> None:
        """Execute one motion `command`, or stop by a reflex where it breaks a limit."""
        motion = self.motion
        if motion is None or motion.stopping:
            return
        if not readable(motion.generator, command):
            self._finish(MoveStatus.INPUT_ERROR_ABORTED)
            self._brake()
            return

        tool = self.configuration.tool
        self.ticks += 1
        motion.missed = 0
        try:
            posture = follow(
                motion.generator,
                old=self.posture,
                command=command,
                tool=tool,
                first=not motion.started,
            )
            check_tool_position(posture.reached)
            check_ends(
                posture.q,
                posture.joints.velocity,
                CARTESIAN_JOINT if motion.generator in CARTESIAN else JOINT,
                PUBLISHED[self.revision],
            )
            self.body.check(posture.q)
        except Violation as violation:
            self.reflex(violation.reflex)
            self._brake()
            return

        self.posture = posture
        motion.started = True
        self._check_contact()
        if self.motion is not None and command.finished:
            self.posture = Posture.resting(self.posture.q, tool)
            self._finish(MoveStatus.SUCCESS)
            self._send_late_replies()

    def miss(self) -> None:
        """Pass a tick of 1 ms without a command: extrapolate or hold the motion, or
        stop by a reflex after MOST_MISSED_TICKS.

        A robot that holds goes on with the next command at the rates it had.
        """
        motion = self.motion
        if motion is None or not motion.started:
            return
        missed = motion.missed + 1
        if not self.holds:
            self.step(extrapolate(self.posture, self.time))
        motion.missed = missed
        if missed > MOST_MISSED_TICKS and self.motion is not None:
            self.reflex(Reflex.COMMUNICATION_CONSTRAINTS_VIOLATION)

    def advance(self) -> None:
        """Advance the robot's time by 1 ms, and with it an arm that lags behind its
        commands.
        """
        self.time += 1
        if self.trailing is not None:
            self.trailing.tick(self.posture.q)
        self.reported.tick(self.posture.joints, self.measured.joints)

    def rest(self) -> None:
        """Pass a tick of 1 ms without a command: brake an arm that shall stop, and let
        pending replies go once it is at rest.
        """
        if not self.moving:
            self._brake()
        self._check_contact()
        if self.motion is not None and self.motion.stopping and self.posture.at_rest:
            self._finish(MoveStatus.PREEMPTED)
        if self.motion is None and self.posture.at_rest:
            self._send_late_replies()

    def _brake(self) -> None:
        if not self.posture.at_rest:
            self.posture = self.posture.brake(self.configuration.tool)

    def _check_contact(self) -> None:
        """Estimate the contact from all forces on the tool, and stop by a reflex where
        it exceeds a collision threshold in a motion.
        """
        force = self.pushed
        if self.push is not None:
            force = force + self.push(self.measured.reached, self.time / 1000)
        if not force.any():
            self.contact = NO_CONTACT
            return
        self.contact = Contact.of_force(self.posture, self.configuration, force)
        if self.motion is not None and self.contact.reflex is not None:
            self.reflex(self.contact.reflex)

    def _finish(self, status: MoveStatus) -> None:
        """End the motion with `status`; its reply comes before others that are
        pending.
        """
        if self.motion is not None:
            self.waiting.insert(
                0, LateReply(Command.MOVE, self.motion.command_id, status)
            )
            self.motion = None
            self.mode = RobotMode.IDLE

    def _send_late_replies(self) -> None:
        waiting = self.waiting
        for late in waiting:
            if (
                late.command is Command.AUTOMATIC_ERROR_RECOVERY
                and self.mode is RobotMode.REFLEX
            ):
                self.mode = RobotMode.IDLE
                self.errors = frozenset()
        self.late += waiting
        waiting.clear()


def resting_robot(
    start: Array | None = None, push: Push | None = None, solids: Solids | None = None
) -> EmulatedRobot:
    """Emulated robot at rest with joints `start` (7,) [rad], by default in its home
    posture.

    Its body may move between `solids`; `push` gives the force on its tool.
    """
    configuration = Configuration()
    posture = Posture.resting(
        np.array(HOME if start is None else start), configuration.tool
    )
    body = BodyCheck(solids)
    return EmulatedRobot(posture, push=push, body=body, configuration=configuration)
