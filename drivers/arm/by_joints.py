"""Converts commanded poses of the hand to joints, with the elbow kept at its first angle.

The client library's Cartesian commands carry no elbow: the robot's own inverse kinematics would
choose one (frankx#22), and over a fold it may wander into a joint's end.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np

from drivers.arm.failure import Cause, Failed, Failure
from drivers.arm.setpoint import largest_difference
from drivers.arm.way import ROUNDING, Course, go_on
from drivers.franka.kinematics import forward, pose_and_jacobian
from drivers.franka.tracking import ELBOW_JOINT, joint_step
from drivers.motion import TICK
from drivers.types import Array

RETURN = 20.0  # 1/s, how fast an elbow comes back that went on by itself
Numbers = list[float]


class DrivenByJoints(Protocol):
    """Interface of a robot that runs a joint motion, such as `drivers.arm.robot.Robot`."""

    def start_joints(self) -> Any:
        """Start a motion that follows joint positions."""

    def read(self, motion: Any, *, awaited: bool = True) -> Any:
        """The robot's next state; unless `awaited`, one that arrived earlier will do."""

    def write_joints(self, motion: Any, joints: Numbers, *, last: bool = False) -> None:
        """Send the joints (7,) [rad] for this tick; `last` ends the motion."""


class Moment(NamedTuple):
    """Time [s] of a robot's state, with the interface of the library's durations."""

    seconds: float

    def to_sec(self) -> float:
        """This time [s]."""
        return self.seconds


class PosedState:
    """A robot's state at `time` [s] with the hand's commanded pose, twist and acceleration."""

    def __init__(
        self, state: Any, time: float, pose: Numbers, twist: Numbers, change: Numbers
    ) -> None:
        self._state, self.time = state, Moment(time)
        self.O_T_EE_c, self.O_dP_EE_c, self.O_ddP_EE_c = pose, twist, change

    def __getattr__(self, name: str) -> Any:
        return getattr(self._state, name)


class ByJoints:
    """Adapter that takes poses of the hand and sends a robot the joints (7,) [rad] for them.

    To find out how a motion goes on from where a robot is that missed a command takes a part of a
    tick that may be all of it: then each answer would be late, and the robot would hear none. On
    its `own_clock` the answer is therefore made for the tick after, until which a robot goes on by
    itself in a known way, and is sent once it has come there.
    """

    def __init__(self, robot: DrivenByJoints, *, own_clock: bool = False) -> None:
        """Drive `robot`; on its `own_clock` each command is computed a tick ahead."""
        self._robot, self._own_clock = robot, own_clock
        self._ahead = False  # whether `_here` is where the robot will be a tick after `_time`
        self._here: Course | None = None
        self._sent: Numbers = []
        self._sent_pose: Array | None = None
        # setpoints (4, 4) of the hand: now, and at the two ticks before
        self._past_poses: list[Array] = []
        self._time = 0.0
        self._kept = self._elbow = self._swing = 0.0  # rad, rad, rad/s: begun, commanded, its rate

    def start_poses(self) -> Any:
        """Start a motion that follows poses of the hand; the elbow keeps its present angle."""
        self._here, self._sent_pose, self._ahead = None, None, False
        return self._robot.start_joints()

    def read(self, motion: Any) -> PosedState:
        """The next state, with the setpoint of the hand computed from that of the joints."""
        state = self._robot.read(motion)
        now, first = state.time.to_sec(), self._here is None
        if self._here is None:
            here, ticks = self._begin(state), 1
        else:
            ticks = max(round((now - self._time) / TICK), 0)
            here = go_on(self._here, self._sent, state, ticks)
        self._here, self._time = here, now
        off = largest_difference(here.place, self._sent)
        if self._sent_pose is not None and ticks == 1 and off < ROUNDING:
            self._past_poses = [self._sent_pose, *self._past_poses[:2]]
        else:
            self._ahead = self._own_clock and not first
            here = self._here = _after_a_tick(here) if self._ahead else here
            self._elbow, self._swing = here.place[ELBOW_JOINT], here.rate[ELBOW_JOINT]
            self._past_poses = _past_poses(here)
        twist, before = (_twist(self._past_poses[i], self._past_poses[i + 1]) for i in range(2))
        change = (twist - before) / TICK
        pose: Numbers = self._past_poses[0].T.ravel().tolist()
        time = self._time + TICK * self._ahead
        return PosedState(state, time, pose, twist.tolist(), change.tolist())

    def _begin(self, state: Any) -> Course:
        """The course of a robot at the first `state` of a motion, whose elbow is kept."""
        begun = Course.of(state)
        self._sent = begun.place
        self._elbow = self._kept = begun.place[ELBOW_JOINT]
        self._swing = 0.0
        return begun

    def write_pose(self, motion: Any, pose: Numbers, *, last: bool = False) -> None:
        """Send the joints that bring the hand to `pose`, 16 numbers by columns.

        Raises Failed before the first state.
        """
        if self._here is None:
            raise Failed(Failure(Cause.COMMAND, "a pose was sent before the first state was read"))
        near = np.array(_after_a_tick(self._here).place)  # from there one step of Newton's is exact
        target = np.reshape(pose, (4, 4)).T
        pull = RETURN * (self._kept - self._elbow) - 2.0 * self._swing  # critically damped
        self._swing += TICK * RETURN * pull
        self._elbow += TICK * self._swing
        step = joint_step(near, *pose_and_jacobian(near), target, self._elbow)
        sent: Numbers = (near + step).tolist()
        if self._ahead and not self._has_arrived(motion) and not last:
            return
        self._sent, self._sent_pose = sent, target
        self._robot.write_joints(motion, sent, last=last)

    def _has_arrived(self, motion: Any) -> bool:
        """Whether the robot is on its predicted course; if not, the course restarts where it is."""
        state = self._robot.read(motion, awaited=False)
        expected, self._ahead = self._here or Course([], [], []), False
        before, self._time = self._time, state.time.to_sec()
        away = largest_difference(expected.place, state.q_d)
        if round((self._time - before) / TICK) == 1 and away < ROUNDING:
            return True
        self._here = Course.of(state)
        self._sent, self._sent_pose = self._here.place, None
        return False


def _after_a_tick(here: Course) -> Course:
    """The course one tick after `here` of a robot without a command, which keeps accelerating."""
    place, rate, change = (np.array(part) for part in here)
    after = rate + TICK * change
    return Course((place + TICK * after).tolist(), after.tolist(), here.change)


def _past_poses(here: Course) -> list[Array]:
    """Poses (4, 4) of the hand now, one tick ago and two ticks ago."""
    place, rate, change = (np.array(part) for part in here)
    before = place - TICK * rate
    ways = (place, before, before - TICK * (rate - TICK * change))
    return list(forward(np.array(ways)))  # in one call: the robot awaits its answer


def _twist(now: Array, before: Array) -> Array:
    """Mean twist (6,) [m/s, rad/s] over a tick between two poses (4, 4).

    A robot takes its rates so, by differences; one by the Jacobian at the end of the tick would be
    wrong by half of what the Jacobian changes in it, and a command that goes on from there would
    push on each time that one was lost.
    """
    turn = now[:3, :3] @ before[:3, :3].T
    angle = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    return np.concatenate([now[:3, 3] - before[:3, 3], np.multiply(0.5, angle)]) / TICK
