"""Connection to a Franka robot by libfranka's Python client: settings, one motion at a
time.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from time import perf_counter
from typing import Any

import numpy as np
import pylibfranka as franka

from drivers.franka.checks import (
    LIBRARY_VERSION,
    read_description,
    require_limits,
    require_tool,
    robot_version,
)
from drivers.franka.failure import ArmFault, Cause, one_line
from drivers.franka.force import ForceGuard, Tare
from drivers.franka.limits import JointLimits
from drivers.franka.model import ArmModel
from drivers.franka.settings import CollisionSettings, FciSettings, RealTime

TARE_STATES = 50  # states, of which the force at rest is the mean
# s at least to read a state that has yet to come; one at hand takes 2e-5
AWAITED = 5e-5

CAUSES: tuple[tuple[type[Exception], Cause], ...] = (
    (franka.ControlException, Cause.REFLEX),
    (franka.CommandException, Cause.REFUSED),
    (franka.NetworkException, Cause.NETWORK),
    (franka.RealtimeException, Cause.REALTIME),
    (franka.InvalidOperationException, Cause.COMMAND),
    (ValueError, Cause.COMMAND),
    (franka.FrankaException, Cause.LIBRARY),
    (RuntimeError, Cause.NETWORK),  # raised by the library when its connection is lost
)
LIBRARY_ERRORS = (franka.FrankaException, RuntimeError, ValueError)
IDENTITY = np.eye(4).ravel().tolist()
ERROR_NAMES = tuple(name for name in dir(franka.Errors) if not name.startswith("_"))


class Robot:
    """Connection to a robot by pylibfranka; every error of the library is raised as
    ArmFault.
    """

    def __init__(
        self, address: str, settings: FciSettings, planned: JointLimits
    ) -> None:
        """Connect to the robot at `address`; ArmFault if its joint limits are not those
        `planned` with.
        """
        description = read_description(address)
        if description is not None:
            require_limits(description, planned)
        self._settings = settings
        self._robot = _connect(address, settings.scheduling)

    def state(self) -> Any:
        """State of the robot now; the first one after a pause is discarded as stale."""
        with _library_errors(self._stop_reason):
            self._robot.read_once()
            return self._robot.read_once()

    def require_ready(self) -> None:
        """Raise ArmFault for a robot that cannot move: stopped, not idle, or with
        errors.
        """
        state = self.state()
        failure = _failure_in(state)
        if failure is None and state.robot_mode != franka.RobotMode.Idle:
            mode = state.robot_mode.name
            failure = ArmFault(
                Cause.REFUSED, f"the robot is not at rest and free, but in {mode}"
            )
        if failure is None and bool(state.current_errors):
            failure = ArmFault(
                Cause.REFLEX, "the robot reports errors", _flags(state.current_errors)
            )
        if failure is not None:
            raise failure

    def require_tool(self) -> None:
        """Raise ArmFault for a tool or load that is not the cell's."""
        require_tool(self.state(), self._settings.tool)

    def reset_tool(self) -> None:
        """Set the robot's end effector and stiffness frame to the nominal ones, and no
        load.
        """
        robot = self._robot
        with _library_errors(self._stop_reason):
            robot.set_EE(IDENTITY)
            robot.set_K(IDENTITY)
            robot.set_load(0.0, [0.0] * 3, [0.0] * 9)

    def configure(self, collision: CollisionSettings) -> None:
        """Set the robot's contact and collision thresholds, which a robot in motion
        refuses.
        """
        lower, upper = [collision.torque_lower] * 7, [collision.torque_upper] * 7
        soft = [collision.force_lower] * 3 + [collision.moment_lower] * 3
        hard = [collision.force_upper] * 3 + [collision.moment_upper] * 3
        with _library_errors(self._stop_reason):
            self._robot.set_collision_behavior(lower, upper, soft, hard)

    def tared_guard(self) -> ForceGuard:
        """Force guard with a tare taken now, at rest; ArmFault for too large a
        force.
        """
        with _library_errors(self._stop_reason):
            self._robot.read_once()  # stale after a pause
            # one after the other, as torques may alternate from state to state
            states = [self._robot.read_once() for _ in range(TARE_STATES)]
        settings = self._settings
        own = ArmModel(settings.tool.mass, settings.tool.centre)
        tare = Tare.from_states(states, settings.rest, own)
        return ForceGuard(settings.guard, settings.guard_torque, tare)

    def recover(self) -> None:
        """Make the robot recover from a reflex, so that it can move again."""
        with _library_errors(self._stop_reason):
            self._robot.automatic_error_recovery()

    def start_joints(self) -> Any:
        """Start a motion commanded by joint positions, and return its handle."""
        with _library_errors(self._stop_reason):
            motion: Any = self._robot.start_joint_position_control(
                franka.ControllerMode.JointImpedance
            )
        return motion

    def read(self, motion: Any) -> Any:
        """Next state of the robot in `motion`; on the robot's own clock a fresh one.

        A state that is already queued is a tick old: answering it would be late, and a
        loop that needs most of its tick would never catch up. It is dropped.
        """
        with _library_errors(self._stop_reason):
            start = perf_counter()
            state: Any = motion.readOnce()[0]
            if not self._settings.in_lock_step and perf_counter() - start < AWAITED:
                state = motion.readOnce()[0]
            return state

    def write_joints(
        self, motion: Any, joints: list[float], *, last: bool = False
    ) -> None:
        """Command the joints (7,) [rad] of this tick of `motion`; `last` ends the
        motion.
        """
        with _library_errors(self._stop_reason):
            command = franka.JointPositions(joints)
            command.motion_finished = last
            motion.writeOnce(command)

    def _stop_reason(self, cause: Cause) -> ArmFault | None:
        """Reason for a stop, from the robot's own state, as an ArmFault; None without a
        reason.
        """
        return None if cause is Cause.NETWORK else _failure_in(self._robot.read_once())


def _failure_in(state: Any) -> ArmFault | None:
    """ArmFault of a robot in `state` whose user stop is pressed or reflex is set; else
    None.
    """
    flagged = (
        state.current_errors if bool(state.current_errors) else state.last_motion_errors
    )
    errors = _flags(flagged)
    if state.robot_mode == franka.RobotMode.UserStopped:
        return ArmFault(Cause.USER_STOP, "the robot's user stop is pressed", errors)
    if state.robot_mode == franka.RobotMode.Reflex:
        return ArmFault(Cause.REFLEX, "the robot has stopped by reflex", errors)
    return None


def _flags(flagged: Any) -> tuple[str, ...]:
    """Names of the errors that are set in `flagged`."""
    return tuple(name for name in ERROR_NAMES if getattr(flagged, name))


@contextmanager
def _library_errors(explain: Callable[[Cause], ArmFault | None]) -> Iterator[None]:
    """Context that raises library errors as ArmFault, of `explain` or by the error's
    class.
    """
    try:
        yield
    except LIBRARY_ERRORS as error:
        cause = next(cause for kind, cause in CAUSES if isinstance(error, kind))
        state_fault = None
        with suppress(*LIBRARY_ERRORS):  # the first error is the one that is reported
            state_fault = explain(cause)
        words = one_line(error)
        if state_fault is not None:
            raise ArmFault(
                state_fault.cause, f"{state_fault.words}: {words}", state_fault.errors
            ) from error
        raise ArmFault(cause, words) from error


def _connect(address: str, realtime: RealTime) -> Any:
    """Connect the library to the robot at `address`, in the real-time mode of the
    settings.
    """
    with _library_errors(lambda _: _mismatch(address)):
        if realtime == "enforce":
            return franka.Robot(address, franka.RealtimeConfig.kEnforce)
        with _scheduler_restored():
            return franka.Robot(address, franka.RealtimeConfig.kIgnore)


@contextmanager
def _scheduler_restored() -> Iterator[None]:
    """Context that undoes the library's real-time priority, harmful without a real-time
    kernel.
    """
    policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        os.sched_setscheduler(0, policy, priority)


def _mismatch(address: str) -> ArmFault | None:
    """ArmFault for a robot whose interface version is not the library's; None if they
    agree.
    """
    spoken = robot_version(address)
    if spoken is None or spoken == LIBRARY_VERSION:
        return None
    return ArmFault(
        Cause.VERSION,
        f"the robot at {address} speaks version {spoken} of its interface, "
        f"the library pylibfranka {version('pylibfranka')} speaks {LIBRARY_VERSION}",
    )
