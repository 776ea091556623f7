"""Jerk-limited setpoints of the gripper's pose for any arm, computed by ruckig."""

from math import exp
from typing import Any, NamedTuple

import ruckig

from drivers.base.errors import Fault
from drivers.base.installation import MotionLimits, Workspace
from drivers.base.types import Pose, Velocity

TICK = 0.001  # s, the servo's period
EXPIRY_TICKS = 100  # ticks for which a velocity target holds
BORDER_ROUNDING = 1e-9  # m or rad, rounding at the border of the workspace
# m or rad, or the same per second: a change too small to have a direction
SMALLEST_CHANGE = 1e-6

Numbers = list[float]
State = tuple[Numbers, Numbers, Numbers]  # position, velocity, acceleration
_STILL = [0.0, 0.0, 0.0]


class PredictedMotion(NamedTuple):
    """Commanded gripper pose, velocity and acceleration [m/s^2, rad/s^2] at a later
    time.
    """

    pose: Pose
    velocity: Velocity
    acceleration: Velocity


def lag_gain(lag: float) -> float:
    """Fraction of the error that a first-order lag of time constant `lag` [s] removes
    per tick.
    """
    return 1.0 if lag == 0 else 1.0 - exp(-TICK / lag)


class MotionProfile:
    """Generator of gripper setpoints, a pose per tick, limited in velocity,
    acceleration and jerk.

    A new command, to move at a velocity, to rest at a pose or to brake, replaces the
    last one. A velocity holds for EXPIRY_TICKS; then the profile brakes and sets
    `expired`. Axes on which a velocity would leave the workspace brake so that the
    gripper stops inside.
    """

    def __init__(self, limits: MotionLimits, workspace: Workspace, start: Pose) -> None:
        """Start the setpoints at rest at `start`, which may lie outside the
        workspace.
        """
        self.expired = False
        self._limits = limits
        self._workspace = workspace
        self._age = 0
        self._ruckig = ruckig.Ruckig(3, TICK)
        self._request = _new_request(limits, ruckig.Synchronization.Phase)
        self._brake = _new_request(limits, ruckig.Synchronization.No)
        self._plan = ruckig.Trajectory(3)
        self._stopping = ruckig.Trajectory(3)
        self._elapsed = 0
        self._target: Numbers | None = None
        self._blocked: frozenset[int] = frozenset()
        self._next_move: Numbers | None = None
        self._position: Numbers = [*start]
        self._velocity: Numbers = _STILL
        self._acceleration: Numbers = _STILL
        self._follow(_STILL)

    @property
    def pose(self) -> Pose:
        """Commanded gripper pose at the last tick."""
        return Pose(*self._position)

    @property
    def velocity(self) -> Velocity:
        """Commanded gripper velocity at the last tick."""
        return Velocity(*self._velocity)

    @property
    def acceleration(self) -> Velocity:
        """Commanded gripper acceleration [m/s^2, rad/s^2] at the last tick."""
        return Velocity(*self._acceleration)

    def predict(self, seconds: float) -> PredictedMotion:
        """Commanded motion in `seconds` from now, if no other command comes."""
        pose, rate, change = self._plan.at_time(self._elapsed * TICK + seconds)
        return PredictedMotion(Pose(*pose), Velocity(*rate), Velocity(*change))

    @property
    def moving(self) -> bool:
        """Whether the commanded motion has yet to come to rest."""
        return self._next_move is not None or self._pending or any(self._velocity)

    def set_velocity(self, velocity: Velocity) -> None:
        """Move at `velocity` from now on; raises Fault `velocity_refused` above the
        limits.
        """
        self._limits.check(velocity)
        self._begin()
        target = [*velocity]
        if target != self._target or self._blocked:
            self._follow(target)

    def move_to(self, pose: Pose) -> None:
        """Move to rest at `pose`: on a straight line from rest, time-optimally from a
        motion.

        Raises Fault `outside_workspace`. Brakes first where the motion would leave the
        workspace.
        """
        self._workspace.check(pose)
        self._begin()
        self._move([*pose])

    def stop(self) -> None:
        """Brake the commanded motion to rest as fast as the limits allow."""
        self._begin()
        self._follow(_STILL)

    def tick(self) -> Numbers:
        """Advance by one tick; returns the commanded x, z [m], pitch [rad] (3,) at its
        end.
        """
        self._age += 1
        if self._age > EXPIRY_TICKS and self._target is not None and any(self._target):
            self.expired = True
            self._follow(_STILL)

        self._elapsed += 1
        state = self._plan.at_time(self._elapsed * TICK)
        if self._target is not None and any(state[1]):
            state = self._keep_inside(state)

        self._position, self._velocity, self._acceleration = state
        if not self._pending:
            self._arrive()

        return self._position

    @property
    def _pending(self) -> bool:
        return bool(self._elapsed * TICK < self._plan.duration)

    def _begin(self) -> None:
        """Discard age, expiry and waiting move of the last command."""
        self.expired = False
        self._age = 0
        self._next_move = None

    def _arrive(self) -> None:
        """Set the setpoint to the end of the plan exactly, and start a move that waited
        for it.
        """
        self._velocity = self._request.target_velocity
        self._acceleration = _STILL
        if self._target is None:
            self._position = self._request.target_position
        if self._next_move is not None:
            goal = self._next_move
            self._next_move = None
            self._move(goal)

    def _follow(
        self,
        target: Numbers,
        blocked: frozenset[int] = frozenset(),
    ) -> None:
        """Plan to velocity `target` (3,); axes `blocked` brake hard."""
        request = self._request
        request.control_interface = ruckig.ControlInterface.Velocity
        velocity = list(target)
        synchronization = [ruckig.Synchronization.Phase] * len(velocity)

        for axis in blocked:
            velocity[axis] = 0.0
            synchronization[axis] = ruckig.Synchronization.No

        request.target_velocity = velocity
        request.per_dof_synchronization = synchronization
        self._target = target
        self._blocked = blocked
        straight = any(target) and not blocked and not any(self._acceleration)
        change = [w - v for w, v in zip(target, self._velocity, strict=True)]
        _limit(request, self._limits, change if straight else _STILL)
        self._calculate(request, self._plan, self._state)
        self._elapsed = 0

    def _move(self, goal: Numbers) -> None:
        """Plan a move to rest at `goal` (3,); brake first if it would leave."""
        request = self._request
        request.control_interface = ruckig.ControlInterface.Position
        request.per_dof_synchronization = None
        request.target_position = goal
        request.target_velocity = _STILL
        self._target = None

        change = _STILL
        if not any(self._velocity) and not any(self._acceleration):
            change = [g - p for g, p in zip(goal, self._position, strict=True)]
        _limit(request, self._limits, change)
        request.max_velocity = _share(request.max_velocity, change)
        self._calculate(request, self._plan, self._state)
        self._elapsed = 0

        if self._leaving(self._plan):
            self._follow(_STILL)
            self._next_move = goal

    def _keep_inside(self, state: State) -> State:
        """Copy of `state` with those axes braked that could not stop within the
        workspace.
        """
        for _ in range(3):  # each round blocks one of the three axes or more
            self._calculate(self._brake, self._stopping, state)
            leaving = self._leaving(self._stopping) - self._blocked
            if self._target is None or not leaving:
                break
            self._follow(self._target, self._blocked | leaving)
            self._elapsed = 1
            state = self._plan.at_time(TICK)
        return state

    def _leaving(self, plan: ruckig.Trajectory) -> frozenset[int]:
        """Numbers of axes on which `plan` leaves the workspace, further than where it
        starts.
        """
        axes = zip(
            self._workspace.low, self._workspace.high, self._position, strict=True
        )
        return frozenset(
            i
            for i, (extent, (low, high, start)) in enumerate(
                zip(plan.position_extrema, axes, strict=True)
            )
            if extent.max > max(high, start) + BORDER_ROUNDING
            or extent.min < min(low, start) - BORDER_ROUNDING
        )

    @property
    def _state(self) -> State:
        return self._position, self._velocity, self._acceleration

    def _calculate(
        self, request: ruckig.InputParameter, plan: ruckig.Trajectory, state: State
    ) -> None:
        """Calculate the trajectory `plan` of `request` from `state`; Fault
        `motion_refused`.
        """
        (
            request.current_position,
            request.current_velocity,
            request.current_acceleration,
        ) = state
        try:
            self._ruckig.calculate(request, plan)
        except ruckig.RuckigError as error:
            raise Fault("motion_refused", " ".join(str(error).split())) from None


def _new_request(limits: MotionLimits, synchronization: ruckig.Synchronization) -> Any:
    request = ruckig.InputParameter(3)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.synchronization = synchronization
    _limit(request, limits, _STILL)
    return request


def _limit(request: Any, limits: MotionLimits, change: Numbers) -> None:
    """Set the limits of a ruckig `request`, lowered in proportion to each axis' share
    of the `change` (3,) of pose or velocity.

    Ruckig leaves the straight line where one axis alone would allow a shorter profile.
    """
    request.max_velocity = [axis.velocity for axis in limits.axes]
    request.max_acceleration = _share(
        [axis.acceleration for axis in limits.axes], change
    )
    request.max_jerk = _share([axis.jerk for axis in limits.axes], change)


def _share(limits: Numbers, change: Numbers) -> Numbers:
    """Limits (3,) of the axes, lowered in proportion to `change` (3,): all axes end
    together.
    """
    sizes = [abs(c) if abs(c) > SMALLEST_CHANGE else 0.0 for c in change]
    if not any(sizes):
        return limits
    pace = min(limit / size for limit, size in zip(limits, sizes, strict=True) if size)
    return [
        pace * size if size else limit
        for limit, size in zip(limits, sizes, strict=True)
    ]
