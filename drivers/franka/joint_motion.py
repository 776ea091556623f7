"""Joint motions of a robot that may miss commands: to given joints, or along poses of
the hand.

A robot stops at a command that does not continue its motion, and goes on by itself
where it receives none: at its acceleration, or not at all. What it reports of its rates
may be filtered, late or zero. So each setpoint continues the command that the robot is
found at by its position alone.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from drivers.base.motion import TICK
from drivers.base.types import Array
from drivers.franka.failure import ArmFault, Cause
from drivers.franka.force import ForceGuard
from drivers.franka.inverse_kinematics import ELBOW_JOINT, joint_step
from drivers.franka.kinematics import forward, pose_and_jacobian, pose_from_columns

if TYPE_CHECKING:  # it needs the robot's library
    from drivers.franka.robot import Robot

AXES = 7
JOINT_SPEED = 0.5  # rad/s
ROUNDING = 3e-7  # rad: more than the rounding of the state
GOAL_TOLERANCE = 5e-5  # rad from the goal, below which the motion has arrived
REST_RATE = 1e-3  # rad/s of its setpoint, slow enough to stop the robot within one tick
ELBOW_GAIN = 20.0  # 1/s, bandwidth of the elbow's return to its angle
SUDDEN = 5.0  # times the gain, in a stop while no command was lost
APPROACH_GAIN = 5.0  # 1/s, rate over the distance near a goal: critically damped
BRAKING_SHARE = 0.8  # of the acceleration, to brake before a goal
SMALLEST_WAY = 1e-9  # rad, avoids a division by 0 at the goal
UNDER_WAY = 4  # commands, the newest, one of which a robot may be found at
SURE = 0.2  # of its distance: another way of going on must explain it better
POSITION_ERROR = 6e-8  # rad, usual rounding of a state
RATE_ERROR = 2e-4  # rad/s, usual error of a rate after lost commands
ACCELERATION_ERROR = 0.1  # rad/s^2, likewise
PREDICTED = 2e-6  # rad from a prediction at which its answer still goes on smoothly

Numbers = list[float]


class JointSetpoint(NamedTuple):
    """Commanded angle (7,) [rad], rate [rad/s] and acceleration [rad/s^2] of joints in
    a tick.
    """

    position: Array
    rate: Array
    acceleration: Array

    @classmethod
    def resting(cls, joints: Numbers) -> "JointSetpoint":
        """Setpoint at rest at `joints` (7,) [rad]."""
        return cls(np.array(joints), np.zeros(AXES), np.zeros(AXES))

    def commanded(self, joints: Numbers) -> "JointSetpoint":
        """Setpoint one tick later of a robot that receives the command `joints` (7,)
        [rad].
        """
        rate = (np.array(joints) - self.position) / TICK
        return JointSetpoint(np.array(joints), rate, (rate - self.rate) / TICK)

    def after(self, ticks: int) -> "JointSetpoint":
        """Setpoint `ticks` later of a robot without a command, at its acceleration."""
        time = ticks * TICK
        rate = self.rate + time * self.acceleration
        mean = self.rate + 0.5 * (time + TICK) * self.acceleration
        return JointSetpoint(self.position + time * mean, rate, self.acceleration)

    def moved_to(self, joints: Numbers, ticks: int) -> "JointSetpoint":
        """Setpoint found at `joints` (7,) [rad] where this one was expected after
        `ticks` ticks.

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
    """Setpoint of a robot that received `sent` last, `off` [rad] from where it is."""

    off: float
    sent: SentCommand
    setpoint: JointSetpoint


class CommandedJoints:
    """Motion of a robot's joints as it is commanded, found again after lost commands.

    A robot that receives no command goes on at its acceleration, or holds its joints;
    which of both is learned from where it is. Its `setpoint` at robot time `seconds` is
    that of the command which explains its position best; what the position differs
    corrects the acceleration with which it went on.
    """

    def __init__(self, state: Any) -> None:
        """Begin at rest at the joints that the robot's `state` reports as commanded."""
        self.setpoint = JointSetpoint.resting(state.q_d)
        self.seconds: float = state.time.to_sec()
        self._sent: deque[SentCommand] = deque(maxlen=UNDER_WAY)
        self._holds = False

    def send(self, joints: Numbers) -> None:
        """Remember the command `joints` (7,) [rad], which answers the last state."""
        setpoint = self.setpoint.commanded(joints)
        self._sent.append(SentCommand(self.seconds + TICK, setpoint))

    def without_command(self) -> JointSetpoint:
        """Setpoint in a tick of a robot that receives no command, as it went on
        before.
        """
        return self.setpoint if self._holds else self.setpoint.after(1)

    def update(self, state: Any) -> bool:
        """Find the setpoint in the robot's `state`; whether it is where the last
        command told it to be, in time.
        """
        before = SentCommand(self.seconds, self.setpoint)
        self.seconds = state.time.to_sec()
        last = self._sent[-1] if self._sent else before
        in_time = self._ticks_since(last) == 0
        if in_time and _distance(state, last.setpoint) == 0.0:
            self.setpoint = last.setpoint
            self._sent.clear()
            return True
        self._find(state, before)
        return in_time and _distance(state, last.setpoint) < ROUNDING

    def _find(self, state: Any, before: SentCommand) -> None:
        """Set the setpoint of a robot in `state` that was at `before` at the last
        one.
        """
        went_on = self._nearest(state, (before, *self._sent), holds=self._holds)
        otherwise = self._nearest(state, (before, *self._sent), holds=not self._holds)
        if otherwise.off < ROUNDING < SURE * went_on.off:
            self._holds = not self._holds
            went_on = otherwise
        while self._sent and self._sent[0].due <= went_on.sent.due:
            self._sent.popleft()
        self.setpoint = went_on.setpoint
        if went_on.off > 0.0:
            ticks = max(self._ticks_since(went_on.sent), 1)
            self.setpoint = went_on.setpoint.moved_to(state.q_d, ticks)

    def _nearest(
        self, state: Any, known: Sequence[SentCommand], *, holds: bool
    ) -> Explanation:
        """The best explanation of where the robot's `state` is by commands `known`."""
        ways = []
        for sent in known:
            ticks = 0 if holds else max(self._ticks_since(sent), 0)
            setpoint = sent.setpoint.after(ticks)
            off = _distance(state, setpoint)
            ways.append(Explanation(off, sent, setpoint))
        return min(ways, key=lambda way: way.off)

    def _ticks_since(self, sent: SentCommand) -> int:
        """Ticks from where `sent` was due until the last state."""
        return round((self.seconds - sent.due) / TICK)


class RateLimits(NamedTuple):
    """Limits on changes of a joint's rate: acceleration [rad/s^2] and jerk [rad/s^3].

    `gain` [1/s] is from an error of the rate to the acceleration, stable where commands
    are lost for 15 ms; without losses a stop may have more.
    """

    acceleration: float
    jerk: float
    gain: float = 20.0


GENTLE = RateLimits(acceleration=1.5, jerk=50.0)
HARD = RateLimits(acceleration=8.0, jerk=2000.0)
"""For a stop out of contact."""


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
        """Joints (7,) [rad] at which the robot was last found."""
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
            or largest_difference(position, self._goal) < GOAL_TOLERANCE
        )

    def tick(self) -> Numbers:
        """Next setpoint (7,) [rad] of all joints."""
        position, rate, acceleration = self._commanded.setpoint
        limits = self._limits
        sudden = self._goal is None and not self._missed
        gain = SUDDEN * limits.gain if sudden else limits.gain
        target = _clip(gain * (self._wanted() - rate), limits.acceleration)
        change = _clip(target - acceleration, limits.jerk * TICK)
        rate = rate + TICK * (acceleration + change)
        joints: Numbers = (position + TICK * rate).tolist()
        self._commanded.send(joints)
        return joints

    def update(self, state: Any) -> None:
        """Go on from where the robot is found in its `state`."""
        self._missed |= not self._commanded.update(state)

    def brake(self, limits: RateLimits = GENTLE) -> None:
        """From now on brake to rest, wherever that is, within `limits`."""
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


@dataclass(frozen=True)
class CartesianState:
    """The robot's `state` at robot time `seconds`, with the hand's commanded pose and
    derivatives.

    Pose (16,) by columns, twist (6,) [m/s, rad/s] and its derivative; all else is of
    `state`.
    """

    state: Any
    seconds: float
    O_T_EE_c: Numbers
    O_dP_EE_c: Numbers
    O_ddP_EE_c: Numbers

    def __getattr__(self, name: str) -> Any:
        return getattr(self.state, name)


class CartesianMotion:
    """Converter of hand poses to joints (7,) [rad], sent to a robot; the elbow, joint
    3, stays.

    The client library's Cartesian commands carry no elbow: the robot's own inverse
    kinematics would choose one (frankx#22), and over a fold it may wander into a
    joint's end.

    Resynchronising after a missed command can take longer than a tick. On its
    `own_clock` the robot is therefore predicted one tick ahead, as it keeps its
    acceleration; the command for that tick is computed meanwhile and sent when the
    robot arrives there.
    """

    def __init__(self, robot: "Robot", *, own_clock: bool = False) -> None:
        """Send joint commands to `robot`, a tick ahead if it runs on its
        `own_clock`.
        """
        self._robot = robot
        self._own_clock = own_clock
        # whether `_setpoint` predicts the robot a tick after its last state
        self._ahead = False
        self._commanded: CommandedJoints | None = None
        self._setpoint = JointSetpoint.resting([0.0] * AXES)
        self._sent_pose: Array | None = None
        self._past_poses: list[Array] = []  # setpoints (4, 4), the newest first
        # rad, rad, rad/s: elbow at the start, its commanded angle and rate
        self._initial_elbow = self._elbow = self._elbow_rate = 0.0

    def start_poses(self) -> Any:
        """Start a motion commanded by hand poses; the elbow (joint 3) keeps its present
        angle.
        """
        self._commanded = None
        self._sent_pose = None
        self._ahead = False
        return self._robot.start_joints()

    def read(self, motion: Any) -> CartesianState:
        """Next state of the robot in `motion`, with the hand's setpoint from that of
        the joints.
        """
        state = self._robot.read(motion)
        if self._commanded is None:
            self._commanded = CommandedJoints(state)
            self._resynchronise(self._commanded.setpoint)
            self._initial_elbow = self._elbow
        else:
            self._advance(self._commanded, state)
        pose, last_pose, pose_before = self._past_poses
        twist = _twist(pose, last_pose)
        twist_change = (twist - _twist(last_pose, pose_before)) / TICK
        return CartesianState(
            state=state,
            seconds=self._commanded.seconds + TICK * self._ahead,
            O_T_EE_c=pose.T.ravel().tolist(),
            O_dP_EE_c=twist.tolist(),
            O_ddP_EE_c=twist_change.tolist(),
        )

    def _advance(self, commanded: CommandedJoints, state: Any) -> None:
        """Continue from the robot's `state`; predict a robot on its own clock after a
        loss.
        """
        received = commanded.update(state)
        if received and self._sent_pose is not None:
            self._setpoint = commanded.setpoint
            self._past_poses = [self._sent_pose, *self._past_poses[:2]]
            return
        self._ahead = self._own_clock
        ahead = commanded.without_command()
        self._resynchronise(ahead if self._ahead else commanded.setpoint)

    def _resynchronise(self, setpoint: JointSetpoint) -> None:
        """Set the joints' setpoint, the elbow's motion and past hand poses to
        `setpoint`.
        """
        self._setpoint = setpoint
        self._elbow = float(setpoint.position[ELBOW_JOINT])
        self._elbow_rate = float(setpoint.rate[ELBOW_JOINT])
        self._past_poses = _past_poses(setpoint)

    def write_pose(self, motion: Any, pose: Numbers, *, last: bool = False) -> None:
        """Command the joints that bring the hand to `pose`, a column-major 4x4 matrix
        (16,).

        Raises ArmFault before the first state.
        """
        commanded = self._begun()
        target = pose_from_columns(pose)
        joints = self._joints_at(target, self._setpoint)
        predicted = not self._ahead or self._await_prediction(motion, commanded)
        if not predicted and not last:
            return
        self._sent_pose = target
        commanded.send(joints)
        self._robot.write_joints(motion, joints, last=last)

    def brake_joints(self, motion: Any) -> None:
        """Bring each joint to rest wherever it is, and end the `motion`.

        Raises ArmFault before the first state.
        """
        joints = JointMotion(self._begun(), [], 0.0)
        joints.brake()
        while not joints.arrived:
            self._robot.write_joints(motion, joints.tick())
            joints.update(self._robot.read(motion))
        self._robot.write_joints(motion, joints.joints, last=True)

    def _begun(self) -> CommandedJoints:
        """What the robot is commanded; ArmFault before the first state."""
        if self._commanded is None:
            raise ArmFault(
                Cause.COMMAND, "a pose was sent before the first state was read"
            )
        return self._commanded

    def _joints_at(self, target: Array, setpoint: JointSetpoint) -> Numbers:
        """Joints (7,) [rad] with the hand at `target` (4, 4), a tick after
        `setpoint`.
        """
        # one Newton step is exact there
        near = setpoint.after(1).position
        # critically damped return of the elbow
        restoring_rate = (
            ELBOW_GAIN * (self._initial_elbow - self._elbow) - 2.0 * self._elbow_rate
        )
        self._elbow_rate += TICK * ELBOW_GAIN * restoring_rate
        self._elbow += TICK * self._elbow_rate
        near_pose, jacobian = pose_and_jacobian(near)
        joints = near + joint_step(near, near_pose, jacobian, target, self._elbow)
        return list(joints.tolist())

    def _await_prediction(self, motion: Any, commanded: CommandedJoints) -> bool:
        """Read the robot's next state; False, and continue from it, where it is not the
        predicted one.
        """
        state = self._robot.read_queued(motion)
        due = commanded.seconds + TICK
        predicted = self._setpoint
        commanded.update(state)
        self._ahead = False
        self._setpoint = commanded.setpoint
        if (
            round((commanded.seconds - due) / TICK) == 0
            and _distance(state, predicted) < PREDICTED
        ):
            return True
        self._sent_pose = None
        return False


def largest_difference(
    first: Sequence[float] | Array, second: Sequence[float] | Array
) -> float:
    """Largest |a - b| over the entries a, b at the same place of `first` and `second`
    (n,).
    """
    return float(max(abs(a - b) for a, b in zip(first, second, strict=True)))


def _distance(state: Any, setpoint: JointSetpoint) -> float:
    """Distance [rad] of the robot's `state` from `setpoint`, which a state would
    round.
    """
    rounded = np.float32(setpoint.position)
    return float(np.abs(np.subtract(state.q_d, rounded)).max())


def _past_poses(setpoint: JointSetpoint) -> list[Array]:
    """Hand poses (4, 4) [m] in the base now, one tick ago and two ticks ago."""
    position, rate, acceleration = setpoint
    one_ago = position - TICK * rate
    two_ago = one_ago - TICK * (rate - TICK * acceleration)
    joints = np.array([position, one_ago, two_ago])
    return list(forward(joints))  # in one call: the robot awaits its answer


def _twist(after: Array, before: Array) -> Array:
    """Mean twist (6,) [m/s, rad/s] over one tick that takes pose `before` (4, 4) to
    `after`.

    The robot differentiates its setpoints in the same way. A twist by the Jacobian at
    the tick's end is wrong by half of the Jacobian's change, an error that adds up with
    each lost command.
    """
    turn = after[:3, :3] @ before[:3, :3].T
    angle = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    return (
        np.concatenate([after[:3, 3] - before[:3, 3], np.multiply(0.5, angle)]) / TICK
    )


def _clip(values: Array, limit: float) -> Array:
    """`values` (7,), in proportion, so that none is beyond `limit`."""
    largest = float(np.abs(values).max())
    return values if largest <= limit else limit / largest * values
