"""What the robot itself enforces on commands, whatever its client checked."""

from dataclasses import dataclass, field

import numpy as np

from drivers.franka import limits
from drivers.franka.tracking import rotation_vector
from drivers.twin.server.reflex import Reflex, Violation
from drivers.types import Array, frozen

TICK = 1e-3  # s
SLACK = (
    1.01  # float32 of the state, from which clients limit their rates, costs a few tenths of 1 %
)


@dataclass(frozen=True, slots=True)
class Rates:
    """Names of the errors of one kind of motion: too fast, and two kinds of discontinuity."""

    velocity: Reflex
    acceleration: Reflex
    jerk: Reflex


JOINT = Rates(
    Reflex.JOINT_MOTION_GENERATOR_VELOCITY_LIMITS_VIOLATION,
    Reflex.JOINT_MOTION_GENERATOR_VELOCITY_DISCONTINUITY,
    Reflex.JOINT_MOTION_GENERATOR_ACCELERATION_DISCONTINUITY,
)
CARTESIAN = Rates(
    Reflex.CARTESIAN_MOTION_GENERATOR_VELOCITY_LIMITS_VIOLATION,
    Reflex.CARTESIAN_MOTION_GENERATOR_VELOCITY_DISCONTINUITY,
    Reflex.CARTESIAN_MOTION_GENERATOR_ACCELERATION_DISCONTINUITY,
)
CARTESIAN_JOINT = Rates(
    Reflex.CARTESIAN_MOTION_GENERATOR_JOINT_VELOCITY_LIMITS_VIOLATION,
    Reflex.CARTESIAN_MOTION_GENERATOR_JOINT_VELOCITY_DISCONTINUITY,
    Reflex.CARTESIAN_MOTION_GENERATOR_JOINT_ACCELERATION_DISCONTINUITY,
)


@dataclass(frozen=True, slots=True)
class Box:
    """Where the tool may be: corners (3,) [m] in the base."""

    low: Array = field(default_factory=lambda: frozen([-1.0, -1.0, -0.5]))
    high: Array = field(default_factory=lambda: frozen([1.0, 1.0, 1.4]))

    def check(self, pose: Array) -> None:
        """Violation for a tool pose (4, 4) outside."""
        place = pose[:3, 3]
        if (place < self.low).any() or (place > self.high).any():
            raise Violation(Reflex.CARTESIAN_POSITION_LIMITS_VIOLATION)


@dataclass(slots=True)
class Course:
    """Commanded velocity and acceleration of the last tick: (7,) of joints or (6,) of the tool."""

    velocity: Array
    acceleration: Array

    def step(self, velocity: Array) -> "Course":
        """The course one tick on with a new `velocity`."""
        return Course(velocity, (velocity - self.velocity) / TICK)


def still(axes: int) -> Course:
    """A course at rest."""
    return Course(np.zeros(axes), np.zeros(axes))


def check_joint_course(old: Course, new: Course, rates: Rates) -> None:
    """Violation where joints run, accelerate or jerk beyond their limits."""
    if (np.abs(new.velocity) > SLACK * limits.VELOCITY).any():
        raise Violation(rates.velocity)
    if (np.abs(new.acceleration) > SLACK * limits.ACCELERATION).any():
        raise Violation(rates.acceleration)
    if (np.abs(new.acceleration - old.acceleration) > SLACK * TICK * limits.JERK).any():
        raise Violation(rates.jerk)


def check_tool_course(old: Course, new: Course) -> None:
    """Violation where the tool moves, accelerates or jerks beyond its limits."""
    jerk = (new.acceleration - old.acceleration) / TICK
    for part, (speed, acceleration, most) in (
        (slice(0, 3), limits.TRANSLATION),
        (slice(3, 6), limits.ROTATION),
    ):
        if _length(new.velocity[part]) > SLACK * speed:
            raise Violation(CARTESIAN.velocity)
        if _length(new.acceleration[part]) > SLACK * acceleration:
            raise Violation(CARTESIAN.acceleration)
        if _length(jerk[part]) > SLACK * most:
            raise Violation(CARTESIAN.jerk)


def check_elbow_course(old: Course, new: Course) -> None:
    """Violation where the elbow (1,) swings beyond its limits."""
    speed, acceleration, jerk = limits.ELBOW
    change = np.abs(new.acceleration - old.acceleration) / TICK
    if (
        abs(new.velocity[0]) > SLACK * speed
        or abs(new.acceleration[0]) > SLACK * acceleration
        or change[0] > SLACK * jerk
    ):
        raise Violation(Reflex.CARTESIAN_MOTION_GENERATOR_ELBOW_LIMIT_VIOLATION)


def check_joints(q: Array, velocity: Array, position: Reflex, rate: Reflex) -> None:
    """Violation for joints (7,) beyond their ends, or faster than they could still brake."""
    if (q < limits.POSITION_LOW).any() or (q > limits.POSITION_HIGH).any():
        raise Violation(position)
    slowest, fastest = limits.velocity_bounds(q)
    tolerance = SLACK * TICK * limits.ACCELERATION
    if (velocity < slowest - tolerance).any() or (velocity > fastest + tolerance).any():
        raise Violation(rate)


def check_end(joints: Course, rates: Rates) -> None:
    """Violation for a motion that is declared finished while it runs."""
    if (np.abs(joints.velocity) > SLACK * TICK * limits.ACCELERATION).any():
        raise Violation(rates.acceleration)


def twist_of(old: Array, new: Array) -> Array:
    """Velocity (6,) in the base that takes pose `old` (4, 4) to `new` in one tick."""
    twist = np.empty(6)
    twist[:3] = new[:3, 3] - old[:3, 3]
    twist[3:] = rotation_vector(new[:3, :3] @ old[:3, :3].T)
    return twist / TICK


def _length(vector: Array) -> float:
    return float(np.sqrt(vector @ vector))
