"""The robot through its maker's library: connect, configure, one motion at a time."""

import os
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.metadata import version
from typing import Any, Protocol

import pylibfranka as franka

from drivers.arm.failure import Cause, Failed, Failure, one_line
from drivers.arm.settings import CollisionSettings, FciSettings

LIBRARY_VERSION = 10  # of the robot's interface that pylibfranka 0.21 speaks
PORT = 1337
PROBE = 0.5  # s for a robot to tell its version

CAUSES: tuple[tuple[type[Exception], Cause], ...] = (
    (franka.ControlException, Cause.REFLEX),
    (franka.CommandException, Cause.REFUSED),
    (franka.NetworkException, Cause.NETWORK),
    (franka.RealtimeException, Cause.REALTIME),
    (franka.InvalidOperationException, Cause.COMMAND),
    (ValueError, Cause.COMMAND),
    (franka.FrankaException, Cause.LIBRARY),
    (RuntimeError, Cause.NETWORK),  # what the library raises once its connection is gone
)
ERRORS = tuple(name for name in dir(franka.Errors) if not name.startswith("_"))


class Motion(Protocol):
    """A running motion: one state read, one command written, a thousand times a second."""

    def readOnce(self) -> tuple[Any, Any]:  # noqa: N802
        """The next state."""
        ...

    def writeOnce(self, command: Any) -> None:  # noqa: N802
        """The answer to it."""
        ...


class Robot:
    """One connection; every error comes out as Failed."""

    def __init__(self, address: str, settings: FciSettings) -> None:
        """Connect, as the real-time mode of `settings` says, and set what must be set at rest."""
        enforce = settings.realtime == "enforce"
        mode = franka.RealtimeConfig.kEnforce if enforce else franka.RealtimeConfig.kIgnore
        with _named(lambda _: _mismatch(address)), _scheduler_kept(restore=not enforce):
            self._robot: Any = franka.Robot(address, mode)
        self._settings = settings

    def state(self) -> Any:
        """A fresh state: the first after a pause has waited in the buffer."""
        with _named(self._stopped):
            self._robot.read_once()
            return self._robot.read_once()

    def require_ready(self) -> None:
        """Refuse, as Failed, a robot that could not move."""
        state = self.state()
        failure = failure_in(state)
        if failure is None and state.robot_mode != franka.RobotMode.Idle:
            mode = state.robot_mode.name
            failure = Failure(Cause.REFUSED, f"the robot is not at rest and free, but in {mode}")
        if failure is not None:
            raise Failed(failure)

    def configure(self, collision: CollisionSettings) -> None:
        """Thresholds of the reflexes; refused by the robot in motion."""
        lower, upper = [collision.torque_lower] * 7, [collision.torque_upper] * 7
        soft = [collision.force_lower] * 3 + [collision.moment_lower] * 3
        hard = [collision.force_upper] * 3 + [collision.moment_upper] * 3
        with _named(self._stopped):
            self._robot.set_collision_behavior(lower, upper, soft, hard)

    def recover(self) -> None:
        """Ask the robot to leave its reflex."""
        with _named(self._stopped):
            self._robot.automatic_error_recovery()

    def start_poses(self) -> Motion:
        """A motion that is given poses of the hand."""
        with _named(self._stopped):
            motion: Motion = self._robot.start_cartesian_pose_control(
                franka.ControllerMode.JointImpedance
            )
        return motion

    def start_joints(self) -> Motion:
        """A motion that is given positions of the joints."""
        with _named(self._stopped):
            motion: Motion = self._robot.start_joint_position_control(
                franka.ControllerMode.JointImpedance
            )
        return motion

    def read(self, motion: Motion) -> Any:
        """The next state of a motion."""
        with _named(self._stopped):
            return motion.readOnce()[0]

    def write_pose(self, motion: Motion, pose: list[float], *, last: bool = False) -> None:
        """Command the hand's pose, 16 numbers by columns; `last` ends the motion there."""
        with _named(self._stopped):
            command = franka.CartesianPose(pose)
            command.motion_finished = last
            motion.writeOnce(command)

    def write_joints(self, motion: Motion, joints: list[float], *, last: bool = False) -> None:
        """Command the joints (7,) [rad]; `last` ends the motion there."""
        with _named(self._stopped):
            command = franka.JointPositions(joints)
            command.motion_finished = last
            motion.writeOnce(command)

    def _stopped(self, cause: Cause) -> Failure | None:
        """What the robot's state says of why it stopped; None where it says nothing."""
        return None if cause is Cause.NETWORK else failure_in(self._robot.read_once())


def failure_in(state: Any) -> Failure | None:
    """Why a robot in `state` does not move; None when it could."""
    flagged = state.current_errors if bool(state.current_errors) else state.last_motion_errors
    errors = tuple(name for name in ERRORS if getattr(flagged, name))
    if state.robot_mode == franka.RobotMode.UserStopped:
        return Failure(Cause.USER_STOP, "the robot's user stop is pressed", errors)
    if state.robot_mode == franka.RobotMode.Reflex:
        return Failure(Cause.REFLEX, "the robot has stopped by reflex", errors)
    return None


@contextmanager
def _named(explain: Callable[[Cause], Failure | None]) -> Iterator[None]:
    """The library's errors as Failed: by their class, and by the robot's state if it tells more."""
    try:
        yield
    except (franka.FrankaException, RuntimeError, ValueError) as error:
        cause = next(cause for kind, cause in CAUSES if isinstance(error, kind))
        seen = None
        with suppress(Exception):  # the first error is the one that is told
            seen = explain(cause)
        words = one_line(error)
        if seen is not None:
            raise Failed(replace(seen, words=f"{seen.words}: {words}")) from error
        raise Failed(Failure(cause, words)) from error


@contextmanager
def _scheduler_kept(*, restore: bool) -> Iterator[None]:
    """Undo the library's real-time priority, which without a real-time kernel only harms."""
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        if restore:
            os.sched_setscheduler(0, policy, priority)


def _mismatch(address: str) -> Failure | None:
    """The failure that both versions explain, if that is why the robot refused to connect."""
    spoken = robot_version(address)
    if spoken is None or spoken == LIBRARY_VERSION:
        return None
    return Failure(
        Cause.VERSION,
        f"the robot at {address} speaks version {spoken} of its interface, "
        f"the library pylibfranka {version('pylibfranka')} speaks {LIBRARY_VERSION}",
    )


def robot_version(address: str) -> int | None:
    """Version of the interface that a robot answers with; None when it does not answer."""
    request = struct.pack("<IIIHH", 0, 1, 16, LIBRARY_VERSION, 0)
    with suppress(OSError), socket.create_connection((address, PORT), PROBE) as link:
        link.settimeout(PROBE)
        link.sendall(request)
        reply = b""
        while len(reply) < 15 and (more := link.recv(64)):
            reply += more
        if len(reply) >= 15:
            return int(struct.unpack_from("<BH", reply, 12)[1])
    return None
