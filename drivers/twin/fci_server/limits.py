"""Limits that the emulated robot enforces on commands: joints, tool, elbow,
collisions.
"""

from dataclasses import dataclass
from math import hypot

import numpy as np

from drivers.base.motion import TICK
from drivers.base.types import Array, frozen
from drivers.franka import limits
from drivers.franka.collision import Solids, self_clearance
from drivers.twin.fci_server.posture import Rates
from drivers.twin.fci_server.wire import Reflex

# Clients limit their rates by the state, which the wire rounds.
LIMIT_FACTOR = 1.01  # float32 of the state costs a few tenths of 1 %
# m, of the tool's space
TOOL_LOW, TOOL_HIGH = frozen([-1.0, -1.0, -0.5]), frozen([1.0, 1.0, 1.4])
LEVER = 1.3  # m at most by which a point of the arm moves per rad of any joint
DEEPER = 1e-6  # m by which a touch must grow to count again: the arm may leave it


class Violation(Exception):
    """Raised for a command that breaks a limit of the robot; `reflex` is the error it
    reports.
    """

    def __init__(self, reflex: Reflex) -> None:
        super().__init__(reflex.name.lower())
        self.reflex = reflex


@dataclass(frozen=True, slots=True)
class JointReflexes:
    """Errors that the robot reports where a joint breaks its limit of position,
    velocity, acceleration or jerk.
    """

    position: Reflex
    velocity: Reflex
    acceleration: Reflex
    jerk: Reflex


JOINT = JointReflexes(
    position=Reflex.JOINT_MOTION_GENERATOR_POSITION_LIMITS_VIOLATION,
    velocity=Reflex.JOINT_MOTION_GENERATOR_VELOCITY_LIMITS_VIOLATION,
    acceleration=Reflex.JOINT_MOTION_GENERATOR_VELOCITY_DISCONTINUITY,
    jerk=Reflex.JOINT_MOTION_GENERATOR_ACCELERATION_DISCONTINUITY,
)
CARTESIAN_JOINT = JointReflexes(
    position=Reflex.CARTESIAN_MOTION_GENERATOR_JOINT_POSITION_LIMITS_VIOLATION,
    velocity=Reflex.CARTESIAN_MOTION_GENERATOR_JOINT_VELOCITY_LIMITS_VIOLATION,
    acceleration=Reflex.CARTESIAN_MOTION_GENERATOR_JOINT_VELOCITY_DISCONTINUITY,
    jerk=Reflex.CARTESIAN_MOTION_GENERATOR_JOINT_ACCELERATION_DISCONTINUITY,
)
# of the tool, with its limits of translation and rotation: velocity, acceleration, jerk
TOOL_REFLEXES = (
    Reflex.CARTESIAN_MOTION_GENERATOR_VELOCITY_LIMITS_VIOLATION,
    Reflex.CARTESIAN_MOTION_GENERATOR_VELOCITY_DISCONTINUITY,
    Reflex.CARTESIAN_MOTION_GENERATOR_ACCELERATION_DISCONTINUITY,
)


class BodyCheck:
    """Check of the arm for collisions with itself and with solids, skipped while the
    joints have moved too little for one.
    """

    def __init__(self, solids: Solids | None = None) -> None:
        """Check the arm for collisions with `solids`, or with itself alone."""
        self._solids = solids
        self._checked_q = np.zeros(7)
        self._room = 0.0  # m, at the joints checked last
        self._gaps: dict[Reflex, float] = {}  # m, to itself and to the solids

    def check(self, q: Array) -> None:
        """Raise Violation where joints `q` (7,) [rad] bring the arm into itself or a
        solid deeper than at the last check: it may leave a touch.
        """
        travel = LEVER * float(np.abs(q - self._checked_q).sum())
        if travel < self._room:
            return

        gaps = {Reflex.SELF_COLLISION_AVOIDANCE_VIOLATION: float(self_clearance(q))}
        if self._solids is not None:
            gaps[Reflex.CARTESIAN_REFLEX] = float(self._solids.clearance(q).min())

        last_gaps = self._gaps
        self._gaps = gaps
        self._checked_q = np.array(q)
        self._room = min(gaps.values())

        for reflex, gap in gaps.items():
            deepest_allowed = min(last_gaps.get(reflex, 0.0), 0.0) - DEEPER
            if gap < deepest_allowed:
                raise Violation(reflex)


# The checks below run in every tick: for few numbers floats are faster than arrays.


def check_joints(old: Rates, new: Rates, reflexes: JointReflexes) -> None:
    """Raise Violation where the joints' rates `new`, one tick of 1 ms after `old`,
    break a limit; `reflexes` are the errors for it.
    """
    if _beyond(new.velocity, _JOINT_VELOCITY):
        raise Violation(reflexes.velocity)
    if _beyond(new.acceleration, _JOINT_ACCELERATION):
        raise Violation(reflexes.acceleration)
    if _beyond(new.acceleration - old.acceleration, _JOINT_JERK):
        raise Violation(reflexes.jerk)


def check_ends(
    q: Array, velocity: Array, reflexes: JointReflexes, joints: limits.JointLimits
) -> None:
    """Raise Violation for joints at `q` (7,) [rad] beyond an end of their range, or at
    `velocity` (7,) [rad/s] too fast to brake before it.
    """
    if joints.margins(q).min() < 0:
        raise Violation(reflexes.position)
    slowest, fastest = joints.velocity_bounds(q)
    if np.minimum(velocity - slowest, fastest - velocity).min() < -_BRAKING:
        raise Violation(reflexes.velocity)


def check_tool_position(pose: Array) -> None:
    """Raise Violation for a tool pose (4, 4) in the base's frame that is outside of the
    box from TOOL_LOW to TOOL_HIGH [m].
    """
    position = pose[:3, 3]
    if np.minimum(position - TOOL_LOW, TOOL_HIGH - position).min() < 0:
        raise Violation(Reflex.CARTESIAN_POSITION_LIMITS_VIOLATION)


def check_tool_rates(old: Rates, new: Rates) -> None:
    """Raise Violation where the tool's rates `new` (6,), one tick of 1 ms after `old`
    (6,), break a limit.

    Velocity, acceleration and jerk are checked in turn: the norms of translation (first
    three) and rotation, each with 1 % of tolerance. The Violation carries the reflex of
    the first to exceed.
    """
    motions = (
        new.velocity,
        new.acceleration,
        (new.acceleration - old.acceleration) / TICK,
    )
    checks = zip(
        motions, limits.TRANSLATION, limits.ROTATION, TOOL_REFLEXES, strict=True
    )
    for rates, translation, rotation, reflex in checks:
        moves = hypot(*rates[:3].tolist())
        turns = hypot(*rates[3:].tolist())
        if moves > LIMIT_FACTOR * translation or turns > LIMIT_FACTOR * rotation:
            raise Violation(reflex)


def check_swing(old: Array, new: Array) -> None:
    """Raise Violation where the elbow's rate, acceleration or jerk breaks a limit;
    `old` and `new` (3,) are its angle, rate and acceleration [rad, s].
    """
    rates = (*new[1:].tolist(), float(new[2] - old[2]) / TICK)
    if any(abs(rate) > limit for rate, limit in zip(rates, _ELBOW, strict=True)):
        raise Violation(Reflex.CARTESIAN_MOTION_GENERATOR_ELBOW_LIMIT_VIOLATION)


def check_end(joints: Rates, reflexes: JointReflexes) -> None:
    """Raise Violation for a motion that is declared finished while the arm still
    moves.
    """
    if _beyond(joints.velocity, _JOINT_STANDSTILL):
        raise Violation(reflexes.acceleration)


def _beyond(values: Array, limits: tuple[float, ...]) -> bool:
    return any(
        abs(value) > limit for value, limit in zip(values.tolist(), limits, strict=True)
    )


def _with_tolerance(limit: Array, time: float = 1.0) -> tuple[float, ...]:
    """Published limits `limit` of the axes times `time` [s], widened by the factor
    LIMIT_FACTOR.
    """
    return tuple((LIMIT_FACTOR * time * limit).tolist())


_ELBOW = _with_tolerance(np.array(limits.ELBOW))
_JOINT_VELOCITY = _with_tolerance(np.array(limits.FR3.velocity))
_JOINT_ACCELERATION = _with_tolerance(limits.ACCELERATION)
# as change of the acceleration in one tick
_JOINT_JERK = _with_tolerance(limits.JERK, TICK)
_JOINT_STANDSTILL = _with_tolerance(limits.ACCELERATION, TICK)
_BRAKING = max(_JOINT_STANDSTILL)  # rad/s, reduction by one tick of braking
