"""Joint motions of a robot that may miss commands: to given joints, or along poses of
the hand.

A robot stops at a command that does not continue its motion, and goes on by itself
where it receives none: at its acceleration, or not at all. What it reports of its rates
may be filtered, late or zero. So each setpoint continues the command that the robot is
found at by its position alone, within limits of acceleration and jerk.
"""

from collections import deque
from collections.abc import Callable, Sequence
from math import sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from drivers.base.motion import TICK
from drivers.base.types import Array
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.force import ForceGuard
from drivers.franka.inverse_kinematics import ELBOW_JOINT, joint_step
from drivers.franka.kinematics import pose_and_jacobian
from drivers.franka.limits import ACCELERATION, JERK

if TYPE_CHECKING:  # it needs the robot's library
    from drivers.franka.robot import Robot

AXES = 7
JOINT_SPEED = 0.5  # rad/s
ROUNDING = 3e-7  # rad: more than the rounding of the state
GOAL_TOLERANCE = 5e-5  # rad from the goal, below which the motion has arrived
REST_RATE = 1e-3  # rad/s of its setpoint, slow enough to stop the robot within one tick
# 1/s, bandwidth of the return to a path, critically damped: of a robot that goes on by
# itself without commands, and of one that holds, which they cannot take further away
FOLLOWING, FOLLOWING_HELD = 20.0, 60.0
SUDDEN = 5.0  # times the gain, in a stop while no command was lost
APPROACH_GAIN = 5.0  # 1/s, rate over the distance near a goal: critically damped
BRAKING_SHARE = 0.8  # of the acceleration, to brake before a goal
SMALLEST_WAY = 1e-9  # rad, avoids a division by 0 at the goal
UNDER_WAY = 4  # commands, the newest, one of which a robot may be found at
SURE = 0.2  # of its distance: another way of going on must explain it better
POSITION_ERROR = 6e-8  # rad, usual rounding of a state
RATE_ERROR = 2e-4  # rad/s, usual error of a rate after lost commands
ACCELERATION_ERROR = 0.1  # rad/s^2, likewise

Numbers = list[float]


class JointSetpoint(NamedTuple):
    """Commanded angles (7,) [rad], rates (7,) [rad/s] and accelerations (7,) [rad/s^2]
    of the joints in one tick.
    """

    position: Array
    rate: Array
    acceleration: Array

    @classmethod
    def resting(cls, joints: Numbers) -> "JointSetpoint":
        """Setpoint at rest at `joints` (7,) [rad]."""
        return cls(np.array(joints), np.zeros(AXES), np.zeros(AXES))

    def to(self, joints: Numbers | Array, ticks: int = 1) -> "JointSetpoint":
        """Setpoint of a robot that moves to `joints` (7,) [rad] within `ticks`, at one
        constant acceleration.
        """
        position = np.array(joints)
        mean = (position - self.position) / (ticks * TICK)
        acceleration = (mean - self.rate) / (0.5 * (ticks + 1) * TICK)
        rate = mean + 0.5 * (ticks - 1) * TICK * acceleration
        return JointSetpoint(position, rate, acceleration)

    def after(self, ticks: int) -> "JointSetpoint":
        """Setpoint that a robot without a command reaches `ticks` later by keeping its
        acceleration.
        """
        acceleration = self.acceleration
        time = ticks * TICK
        rate = self.rate + time * acceleration
        mean = self.rate + 0.5 * (time + TICK) * acceleration
        return JointSetpoint(self.position + time * mean, rate, acceleration)

    def moved_to(self, joints: Numbers, ticks: int) -> "JointSetpoint":
        """Setpoint corrected for a robot found at `joints` (7,) [rad] where this one
        was expected after `ticks` ticks.

        The difference is of rate and acceleration at their beginning, each by its usual
        error (a Kalman filter's update).
        """
        time = ticks * TICK
        by_rate = time  # rad of position per rad/s
        by_acceleration = 0.5 * time * (time + TICK)
        off = np.subtract(joints, self.position) / (
            (by_rate * RATE_ERROR) ** 2
            + (by_acceleration * ACCELERATION_ERROR) ** 2
            + POSITION_ERROR**2
        )
        rate_error = by_rate * RATE_ERROR**2 * off
        change = by_acceleration * ACCELERATION_ERROR**2 * off
        rate = self.rate + rate_error + time * change
        return JointSetpoint(np.array(joints), rate, self.acceleration + change)


class SentCommand(NamedTuple):
    """Command to a robot: the setpoint of one that receives it, due at robot time
    `due` [s].
    """

    due: float
    setpoint: JointSetpoint


class Explanation(NamedTuple):
    """Setpoint of a robot if the command `sent` was the last that it received, and its
    distance `off` [rad] from where it is.
    """

    off: float
    sent: SentCommand
    setpoint: JointSetpoint


class RateLimits(NamedTuple):
    """Limits on how a joint's rate changes: acceleration [rad/s^2] and jerk
    [rad/s^3].

    `gain` [1/s] is from an error of the rate to the acceleration, stable where commands
    are lost for 15 ms; without losses a stop may have more.
    """

    acceleration: float
    jerk: float
    gain: float = 20.0


GENTLE = RateLimits(acceleration=1.5, jerk=50.0)
HARD = RateLimits(acceleration=8.0, jerk=2000.0)
"""For a stop out of contact."""
ALLOWED = RateLimits(0.98 * float(ACCELERATION.min()), 0.98 * float(JERK.min()))
"""Of the robot itself, less the rounding of what it reports."""


class CommandedJoints:
    """Motion of a robot's joints as it is commanded, found again after lost commands.

    A robot that receives no command goes on at its acceleration, or holds its joints;
    which of both is learned from where it is. Its `setpoint` at robot time `seconds` is
    that of the command which explains its position best; what the position differs
    corrects the acceleration with which it went on. `holds` is whether it was found to
    hold, `stands` whether it holds now, and the last command has to be sent again.
    """

    def __init__(self, state: Any) -> None:
        """Begin at rest at the joints that the robot's `state` reports as commanded."""
        self.setpoint = JointSetpoint.resting(state.q_d)
        self.seconds: float = state.time.to_sec()
        self.holds = self.stands = False
        self._alone = 0  # ticks since the robot got a command
        self._sent: deque[SentCommand] = deque(maxlen=UNDER_WAY)

    def go_on(self, acceleration: Array, limits: RateLimits) -> Numbers:
        """Next joint command (7,) [rad], which answers the last state and continues
        with `acceleration` (7,) [rad/s^2].

        It is reduced to the `limits`, and so is its change, in the mean over the ticks
        in which the robot got no command.
        """
        position, rate, before = self.setpoint
        wanted = _clip(acceleration, limits.acceleration)
        jerk = min((1 + self._alone) * limits.jerk, ALLOWED.jerk)
        change = _clip(wanted - before, jerk * TICK)
        joints: Numbers = (position + TICK * (rate + TICK * (before + change))).tolist()
        self._send(joints)
        return joints

    def again(self) -> Numbers:
        """The last joint command (7,) [rad] again, for a robot that stands still."""
        joints: Numbers = self._sent[-1].setpoint.position.tolist()
        self._send(joints)
        return joints

    def _send(self, joints: Numbers) -> None:
        """Remember the command `joints` (7,) [rad], which answers the last state."""
        setpoint = self.setpoint.to(joints)
        self._sent.append(SentCommand(self.seconds + TICK, setpoint))

    def update(self, state: Any) -> bool:
        """Find the setpoint that the robot's `state` shows; returns whether it is where
        the last command told it to be, in time.
        """
        sent = self._sent
        before = SentCommand(self.seconds, self.setpoint)
        self.seconds = state.time.to_sec()
        last = sent[-1] if sent else before
        in_time = self._ticks_since(last) == 0
        self.stands = False
        if in_time and _distance(state, last.setpoint) == 0.0:
            self.setpoint = last.setpoint
            sent.clear()
            self._alone = 0
            return True

        self._find(state, before)
        return in_time and _distance(state, last.setpoint) < ROUNDING

    def _find(self, state: Any, before: SentCommand) -> None:
        """Set the setpoint for a robot in `state` that followed the command `before` at
        the previous state.
        """
        sent = self._sent
        found = self._nearest(state, (before, *sent), holds=self.holds)
        otherwise = self._nearest(state, (before, *sent), holds=not self.holds)
        if otherwise.off < ROUNDING < SURE * found.off:
            self.holds = not self.holds
            found = otherwise

        # commands up to that one are answered, or lost
        while sent and sent[0].due <= found.sent.due:
            sent.popleft()
        got_none = found.sent is before
        self.stands = self.holds and got_none and bool(sent)
        since = self._ticks_since(found.sent)
        self._alone = since + got_none * self._alone

        self.setpoint = found.setpoint
        if found.off > 0.0:
            self.setpoint = found.setpoint.moved_to(state.q_d, max(since, 1))

    def _nearest(
        self, state: Any, known: Sequence[SentCommand], *, holds: bool
    ) -> Explanation:
        """Best explanation of the position in the robot's `state` by one of the
        commands `known`.
        """
        ways = []
        for sent in known:
            ticks = 0 if holds else max(self._ticks_since(sent), 0)
            setpoint = sent.setpoint.after(ticks)
            off = _distance(state, setpoint)
            ways.append(Explanation(off, sent, setpoint))
        return min(ways, key=lambda way: way.off)

    def _ticks_since(self, sent: SentCommand) -> int:
        """Number of ticks from when the command `sent` was due until the last state."""
        return round((self.seconds - sent.due) / TICK)


class JointMotion:
    """Generator of joint setpoints (7,) [rad] on the straight way to a goal, one per
    tick.

    Each goes on from where the robot is found, at a rate that the distance to the goal
    allows: a plan in time would reverse its acceleration at the last moment, and a
    robot that misses commands would oscillate about the goal.
    """

    def __init__(self, begun: CommandedJoints, goal: Numbers, share: float) -> None:
        """Move from where the robot is commanded, as `begun`, to rest at joints `goal`
        (7,) [rad], at `share` of speed.
        """
        self._commanded = begun
        self._goal: Array | None = np.array(goal)
        self._speed = share * JOINT_SPEED
        self._limits = GENTLE._replace(acceleration=share * GENTLE.acceleration)
        self._missed = False

    @property
    def joints(self) -> Numbers:
        """Joint angles (7,) [rad] at which the robot was last found."""
        found: Numbers = self._commanded.setpoint.position.tolist()
        return found

    @property
    def arrived(self) -> bool:
        """Whether the robot rests at the goal, or anywhere once it brakes."""
        position, rate, _ = self._commanded.setpoint
        if np.abs(rate).max() >= REST_RATE:
            return False
        return (
            self._goal is None
            or _largest_difference(position, self._goal) < GOAL_TOLERANCE
        )

    def tick(self) -> Numbers:
        """Next setpoint (7,) [rad] of all joints."""
        limits = self._limits
        sudden = self._goal is None and not self._missed
        gain = SUDDEN * limits.gain if sudden else limits.gain
        change = gain * (self._wanted() - self._commanded.setpoint.rate)
        return self._commanded.go_on(change, limits)

    def update(self, state: Any) -> None:
        """Go on from where the robot is found in its `state`."""
        self._missed |= not self._commanded.update(state)

    def brake(self, limits: RateLimits = GENTLE) -> None:
        """Brake to rest from now on, wherever that is, within `limits`."""
        self._goal = None
        self._limits = limits

    def _wanted(self) -> Array:
        """Rates (7,) [rad/s] straight to the goal, from which the joints can brake
        there.
        """
        if self._goal is None:
            return np.zeros(AXES)
        away = self._goal - self._commanded.setpoint.position
        furthest = float(np.abs(away).max())
        braking = BRAKING_SHARE * self._limits.acceleration
        near = braking / APPROACH_GAIN**2
        rate = APPROACH_GAIN * furthest
        if furthest > near:
            rate = sqrt(braking * (2 * furthest - near))
        return min(rate, self._speed) / max(furthest, SMALLEST_WAY) * away


def follow_joints(
    robot: "Robot",
    joints: Numbers,
    share: float,
    guard: ForceGuard,
    until: Callable[[Any], bool],
) -> Numbers:
    """Move `robot` to `joints` (7,) [rad] and return the joints (7,) at which it comes
    to rest.

    At a `share` of full speed. It brakes earlier once `until(state)` is true. Raises
    ArmFault for a force beyond the limits of `guard`, once the robot stands.
    """
    motion = robot.start_joints()
    state = robot.read(motion)
    setpoints = JointMotion(CommandedJoints(state), joints, share)
    objection = ""
    while not setpoints.arrived:
        if not objection and until(state):
            setpoints.brake()
        robot.write_joints(motion, setpoints.tick())
        state = robot.read(motion)
        setpoints.update(state)
        objection = objection or guard.objection(state)
        if objection:
            setpoints.brake(HARD)

    robot.write_joints(motion, setpoints.joints, last=True)
    if objection:
        raise ArmFault(Cause.CONTACT, objection)

    return list(state.q)


class HandMotion:
    """Generator of joint setpoints (7,) [rad] that take the hand along given poses.

    The elbow, joint 3, stays. The client library's Cartesian commands carry no elbow:
    the robot's own inverse kinematics would choose one (frankx#22), and over a fold it
    may wander into a joint's end.

    The joints of a pose are prepared before the state that they answer arrives, as that
    takes much of a tick. The path goes on while a robot gets no command, whether the
    robot goes on by itself or holds its joints, and it returns to the path.
    """

    def __init__(self, state: Any) -> None:
        """Begin at rest at the joints that the robot's `state` reports as commanded."""
        self._commanded = CommandedJoints(state)
        self._aim = self._commanded.setpoint
        self._elbow = float(self._aim.position[ELBOW_JOINT])
        self._prepared = False
        self._lost = 0  # ticks of the path, which are still to be prepared

    @property
    def ticks_due(self) -> int:
        """Number of ticks of the path until the pose that is to be prepared; 0 where
        one is prepared.
        """
        return 0 if self._prepared else 1 + self._lost

    @property
    def seconds(self) -> float:
        """Robot time [s] of the last state."""
        return self._commanded.seconds

    @property
    def at_rest(self) -> bool:
        """Whether the joints are commanded so slowly that they can stop within one
        tick.
        """
        return bool(np.abs(self._commanded.setpoint.rate).max() < REST_RATE)

    def prepare(self, pose: Array) -> None:
        """Compute the joints with the hand at `pose` (4, 4), which the path reaches
        `ticks_due` ticks after the last one.
        """
        ticks = self.ticks_due
        near = self._aim.after(ticks).position
        near_pose, jacobian = pose_and_jacobian(near)
        # one Newton step is exact there
        joints = near + joint_step(
            q=near, reached=near_pose, jac=jacobian, target=pose, elbow=self._elbow
        )
        self._aim = self._aim.to(joints, ticks)
        self._prepared, self._lost = True, 0

    def tick(self) -> Numbers:
        """Next joint setpoint (7,) [rad]; the prepared one is kept where the last is
        sent again.
        """
        commanded = self._commanded
        if commanded.stands:
            return commanded.again()

        self._prepared = False
        aim = self._aim.after(self._lost)
        found = commanded.setpoint
        before = aim.position - TICK * aim.rate
        away = before - found.position
        faster = aim.rate - TICK * aim.acceleration - found.rate
        gain = FOLLOWING_HELD if commanded.holds else FOLLOWING
        change = aim.acceleration + gain * (2.0 * faster + gain * away)
        return commanded.go_on(change, ALLOWED)

    def rest(self) -> Numbers:
        """Joint setpoint (7,) [rad] at which the robot is found, to stay there or end
        the motion.
        """
        joints: Numbers = self._commanded.setpoint.position.tolist()
        return joints

    def update(self, state: Any) -> None:
        """Go on from where the robot is found in its `state`, on a path that has gone
        on in the ticks in which it got no command.
        """
        commanded = self._commanded
        before = commanded.seconds
        commanded.update(state)
        elapsed = commanded.seconds - before
        self._lost += round(elapsed / TICK) - 1 + commanded.stands


def _largest_difference(
    first: Sequence[float] | Array, second: Sequence[float] | Array
) -> float:
    """Largest |a - b| over the entries a, b at the same index of `first` and `second`
    (n,).
    """
    return float(max(abs(a - b) for a, b in zip(first, second, strict=True)))


def _distance(state: Any, setpoint: JointSetpoint) -> float:
    """Largest difference [rad] of the joints that `state` reports as commanded from
    those of `setpoint`, rounded as the report is.
    """
    rounded = np.float32(setpoint.position)
    return float(np.abs(np.subtract(state.q_d, rounded)).max())


def _clip(values: Array, limit: float) -> Array:
    """`values` (7,), all scaled by one factor so that none is beyond `limit`."""
    largest = float(np.abs(values).max())
    return values if largest <= limit else limit / largest * values
