"""Joint motion to a goal: a plan while every command arrives, afterwards step by step.

A plan in the shortest time turns its acceleration around at the last moment. A robot continues the
acceleration that it has where it hears nothing, so it turns late, overshoots, and swings about the
goal for ever. Step by step the speed falls in proportion to the distance that is left, ten times
more slowly than any such delay, so that each step is right whatever became of the last.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import ruckig

from drivers.arm.failure import Cause, Failed, Failure
from drivers.arm.force import ForceGuard
from drivers.arm.setpoint import largest_difference
from drivers.motion import TICK

AXES = 7
JOINT_SPEED = 0.5  # rad/s
JOINT_ACCELERATION = 1.5  # rad/s^2
JOINT_JERK = 50.0  # rad/s^3 at full speed
HARD_ACCELERATION, HARD_JERK = 8.0, 2000.0  # rad/s^2, rad/s^3 of a stop out of contact
HARD_TAKING_UP = 30.0  # 1/s, likewise: a robot that hears nothing for 15 ms still turns it around
ROUNDING = 3e-7  # rad: more than the rounding of the state
CHANGE_TOLERANCE = 1e-6  # rad/s^2, likewise
GOAL_TOLERANCE = 5e-5  # rad from the goal, from which nothing is corrected any more
REST_RATE = 1e-3  # rad/s at which the robot may be commanded to stand
NEARING = 3.0  # 1/s, speed over the distance that is left
TAKING_UP = 12.0  # 1/s, how fast a joint takes up the speed that is wanted

Numbers = list[float]


class Course(NamedTuple):
    """Joints (7,) [rad] with rates and accelerations, as differences of successive setpoints."""

    place: Numbers
    rate: Numbers
    change: Numbers

    @classmethod
    def of(cls, state: Any) -> "Course":
        """The course of the setpoint in the robot's `state`, as rounded there."""
        return cls(list(state.q_d), list(state.dq_d), list(state.ddq_d))


def go_on(before: Course, sent: Numbers, state: Any, ticks: int) -> Course:
    """Setpoint of a robot in `state`, finer than its rounding, `ticks` after the setpoint `before`.

    A robot that heard its command was at the joints `sent` one tick later; else it accelerates on.
    """
    seen = Course.of(state)
    heard = largest_difference(seen.change, before.change) > CHANGE_TOLERANCE
    place = sent if heard else before.place
    for ago in range(max(ticks - 1, 0) if heard else ticks):
        place = [
            p + TICK * (rate - ago * TICK * change)
            for p, rate, change in zip(place, seen.rate, seen.change, strict=True)
        ]
    return seen if largest_difference(seen.place, place) > ROUNDING else seen._replace(place=place)


class Way:
    """Generator of joint setpoints (7,) [rad] on the way to a goal, one per tick."""

    def __init__(self, state: Any, goal: Numbers, share: float) -> None:
        """Plan from rest in `state` to rest at `goal` (7,) [rad], at a `share` of full speed."""
        start = list(state.q_d)
        self._plan = _plan(start, goal, share)
        self._planner, self._output = (ruckig.Ruckig(AXES, TICK), ruckig.OutputParameter(AXES))
        self._goal: Numbers | None = goal
        self._speed, self._acceleration = share * JOINT_SPEED, share * JOINT_ACCELERATION
        self._jerk, self._taking_up = JOINT_JERK, TAKING_UP
        self._time = state.time.to_sec()
        self._here, self._sent = Course(start, [0.0] * AXES, [0.0] * AXES), start
        self._planned, self._missed = True, False

    @property
    def arrived(self) -> bool:
        """Whether the setpoints have reached the goal."""
        if not self._missed:
            return not self._planned
        still = max(map(abs, self._here.rate)) < REST_RATE
        if self._goal is None:
            return still
        return still and largest_difference(self._here.place, self._goal) < GOAL_TOLERANCE

    def tick(self) -> Numbers:
        """The next setpoint (7,) [rad]; Failed where no motion leads to the goal."""
        self._sent = self._stepwise_setpoint() if self._missed else self._planned_setpoint()
        return self._sent

    def keep_up(self, state: Any) -> None:
        """Continue from the robot's own setpoint in `state` where that is not the one last sent.

        Its state is rounded, and a rounding of 1e-7 rad in one tick is 0.1 rad/s^2. But a robot
        that has heard nothing keeps its acceleration, so where it is follows from what it heard.
        """
        now = state.time.to_sec()
        ticks, self._time = round((now - self._time) / TICK), now
        self._missed = (
            self._missed or ticks != 1 or largest_difference(state.q_d, self._sent) > ROUNDING
        )
        self._here = go_on(self._here, self._sent, state, ticks)

    def brake(self, *, hard: bool = False) -> None:
        """Brake to rest in any posture; if `hard`, as quickly as the joints may."""
        self._goal, self._acceleration = None, JOINT_ACCELERATION
        if hard:
            self._acceleration, self._jerk = HARD_ACCELERATION, HARD_JERK
            self._taking_up = HARD_TAKING_UP
        self._plan.max_acceleration = [self._acceleration] * AXES
        self._plan.max_jerk = [self._jerk] * AXES
        self._plan.control_interface = ruckig.ControlInterface.Velocity
        self._plan.target_velocity = self._plan.target_acceleration = [0.0] * AXES

    def _planned_setpoint(self) -> Numbers:
        result = self._planner.update(self._plan, self._output)
        if result not in (ruckig.Result.Working, ruckig.Result.Finished):
            raise Failed(Failure(Cause.COMMAND, "no motion leads to these joints"))
        self._planned = bool(result == ruckig.Result.Working)
        self._output.pass_to_input(self._plan)
        setpoint: Numbers = self._output.new_position
        return setpoint

    def _stepwise_setpoint(self) -> Numbers:
        wanted = [0.0] * AXES
        if self._goal is not None:
            away = [end - p for end, p in zip(self._goal, self._here.place, strict=True)]
            fastest = NEARING * max(map(abs, away))
            gain = NEARING * min(1.0, self._speed / fastest) if fastest else 0.0
            wanted = [gain * distance for distance in away]  # one gain for all: straight
        return [self._next_place(*joint) for joint in zip(*self._here, wanted, strict=True)]

    def _next_place(self, place: float, rate: float, change: float, wanted: float) -> float:
        """Setpoint [rad] of one joint, which takes up the rate `wanted` [rad/s]."""
        asked = _within(self._taking_up * (wanted - rate), self._acceleration)
        change += _within(asked - change, self._jerk * TICK)
        return place + TICK * (rate + TICK * change)


def follow_joints(
    robot: Any,
    joints: Numbers,
    share: float,
    guard: ForceGuard,
    left: Callable[[], bool],
    enough: Callable[[Any], bool] = lambda _: False,
) -> Numbers:
    """Bring `robot` to `joints` (7,) [rad] and return the joints (7,) at which it comes to rest.

    It brakes earlier once `left` or, for its state, `enough` is true. Raises Failed for an
    objection of the `guard`, once the robot stands.
    """
    motion = robot.start_joints()
    state = robot.read(motion)
    way, objection = Way(state, joints, share), ""
    while not (way.arrived and _is_still(state)):
        if not objection and (left() or enough(state)):
            way.brake()
        robot.write_joints(motion, way.tick())
        state = robot.read(motion)
        way.keep_up(state)
        objection = objection or guard.objection(state)
        if objection:
            way.brake(hard=True)
    robot.write_joints(motion, list(state.q_d), last=True)
    if objection:
        raise Failed(Failure(Cause.CONTACT, objection))
    return list(state.q)


def _is_still(state: Any) -> bool:
    """Whether the robot's setpoint stands still, up to what one tick takes off smoothly."""
    return bool(max(abs(rate) for rate in state.dq_d) < REST_RATE)


def _plan(start: Numbers, goal: Numbers, share: float) -> Any:
    plan = ruckig.InputParameter(AXES)
    plan.synchronization = ruckig.Synchronization.Phase  # straight from start to goal
    plan.current_position, plan.target_position = start, goal
    plan.current_velocity = plan.current_acceleration = [0.0] * AXES
    plan.max_velocity = [share * JOINT_SPEED] * AXES
    plan.max_acceleration = [share * JOINT_ACCELERATION] * AXES
    plan.max_jerk = [JOINT_JERK] * AXES
    return plan


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)
