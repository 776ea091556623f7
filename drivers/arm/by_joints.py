"""Poses of the hand sent as joints, so that the elbow stays where the motion began.

The client library's Cartesian commands carry no elbow: the robot's own inverse kinematics would
choose one (frankx#22), and over a fold it may wander into a joint's end.
"""

from typing import Any, Protocol

import numpy as np

from drivers.arm.failure import Cause, Failed, Failure
from drivers.arm.way import UNHEARD, Course, go_on
from drivers.franka.kinematics import forward, pose_and_jacobian
from drivers.franka.tracking import ELBOW_JOINT, joint_step
from drivers.motion import TICK
from drivers.types import Array

RETURN = 20.0  # 1/s, how fast an elbow comes back that went on by itself
Numbers = list[float]


class DrivenByJoints(Protocol):
    """Interface of a robot that runs a motion of its joints, such as `drivers.arm.robot.Robot`."""

    def start_joints(self) -> Any:
        """Start the motion."""
        ...

    def read(self, motion: Any) -> Any:
        """The next state."""
        ...

    def write_joints(self, motion: Any, joints: Numbers, *, last: bool = False) -> None:
        """Send the command for this tick."""
        ...


class PosedState:
    """A state whose commanded pose, twist and change are those of the commanded joints."""

    def __init__(self, state: Any, pose: Numbers, twist: Numbers, change: Numbers) -> None:
        self._state = state
        self.O_T_EE_c, self.O_dP_EE_c, self.O_ddP_EE_c = pose, twist, change

    def __getattr__(self, name: str) -> Any:
        return getattr(self._state, name)


class ByJoints:
    """A robot driven by poses of the hand, of which it is sent the joints (7,) [rad]."""

    def __init__(self, robot: DrivenByJoints) -> None:
        self._robot = robot
        self._here: Course | None = None
        self._sent: Numbers = []
        self._sent_pose: Array | None = None
        self._trail: list[Array] = []  # the hand's setpoint (4, 4), and at the two ticks before
        self._time = 0.0

    def start_poses(self) -> Any:
        """Start the motion; the elbow is kept where it is now."""
        self._here, self._sent_pose = None, None
        return self._robot.start_joints()

    def read(self, motion: Any) -> PosedState:
        """The next state, with the hand's setpoint as its joints' setpoint gives it."""
        state = self._robot.read(motion)
        now = state.time.to_sec()
        if self._here is None:
            begun = Course(list(state.q_d), list(state.dq_d), list(state.ddq_d))
            self._here, self._sent, self._time = begun, begun.place, now
            self._elbow = self._kept = begun.place[ELBOW_JOINT]
            self._swing = 0.0
            ticks = 1
        else:
            ticks, self._time = max(round((now - self._time) / TICK), 0), now
            self._here = go_on(self._here, self._sent, state, ticks)
        here = self._here
        off = max(abs(a - b) for a, b in zip(here.place, self._sent, strict=True))
        if self._sent_pose is not None and ticks == 1 and off < UNHEARD:
            self._trail = [self._sent_pose, *self._trail[:2]]
        else:
            self._elbow, self._swing = here.place[ELBOW_JOINT], here.rate[ELBOW_JOINT]
            self._trail = _trail(here)
        twist, before = (_twist(self._trail[i], self._trail[i + 1]) for i in range(2))
        change = (twist - before) / TICK
        pose: Numbers = self._trail[0].T.ravel().tolist()
        return PosedState(state, pose, twist.tolist(), change.tolist())

    def write_pose(self, motion: Any, pose: Numbers, *, last: bool = False) -> None:
        """Send the joints that bring the hand to `pose`, 16 numbers by columns.

        Raises Failed before the first state.
        """
        if self._here is None:
            raise Failed(Failure(Cause.COMMAND, "a pose was sent before the first state was read"))
        place, rate, change = (np.array(part) for part in self._here)
        near = place + TICK * (rate + TICK * change)  # from there one step of Newton's is exact
        target = np.reshape(pose, (4, 4)).T
        pull = RETURN * (self._kept - self._elbow) - 2.0 * self._swing
        self._swing += TICK * RETURN * pull
        self._elbow += TICK * self._swing
        step = joint_step(near, *pose_and_jacobian(near), target, self._elbow)
        self._sent, self._sent_pose = (near + step).tolist(), target
        self._robot.write_joints(motion, self._sent, last=last)


def _trail(here: Course) -> list[Array]:
    """Poses (4, 4) of the hand on a course: now, a tick ago, two ticks ago."""
    place, rate, change = (np.array(part) for part in here)
    before = place - TICK * rate
    ways = (place, before, before - TICK * (rate - TICK * change))
    return list(forward(np.array(ways)))  # at the price of one: the next answer waits for it


def _twist(now: Array, before: Array) -> Array:
    """Mean twist (6,) [m/s, rad/s] over a tick between two poses (4, 4).

    A robot takes its rates so, by differences; one by the Jacobian at the end of the tick would be
    wrong by half of what the Jacobian changes in it, and a command that goes on from there would
    push on each time that one was lost.
    """
    turn = now[:3, :3] @ before[:3, :3].T
    angle = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    return np.concatenate([now[:3, 3] - before[:3, 3], np.multiply(0.5, angle)]) / TICK
