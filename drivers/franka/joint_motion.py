"""Joint motions of a robot that may miss commands: to given joints, or along poses of
the hand.

A robot that receives no command keeps its acceleration, and stops at a command that
does not continue this motion. So each setpoint continues the motion that the robot
reports.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import ruckig

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
ACCELERATION_ROUNDING = 1e-6  # rad/s^2, likewise
GOAL_TOLERANCE = 5e-5  # rad from the goal, below which the motion has arrived
REST_RATE = 1e-3  # rad/s of its setpoint, slow enough to stop the robot within one tick
APPROACH_GAIN = 3.0  # 1/s, speed over the remaining distance
ELBOW_GAIN = 20.0  # 1/s, bandwidth of the elbow's return to its angle

Numbers = list[float]


class JointSetpoint(NamedTuple):
    """Commanded angle (7,) [rad], rate [rad/s] and acceleration [rad/s^2] of joints in
    a tick.
    """

    position: Numbers
    rate: Numbers
    acceleration: Numbers

    @classmethod
    def from_state(cls, state: Any) -> "JointSetpoint":
        """Joint setpoint in the robot's `state`, which rounds its numbers."""
        return cls(list(state.q_d), list(state.dq_d), list(state.ddq_d))

    def after_a_tick(self) -> "JointSetpoint":
        """Setpoint one tick later of a robot without a command, which keeps its
        acceleration.
        """
        position, rate, acceleration = (np.array(part) for part in self)
        rate = rate + TICK * acceleration
        position = position + TICK * rate
        return JointSetpoint(position.tolist(), rate.tolist(), self.acceleration)

    def followed_by(self, state: Any, sent: Numbers, ticks: int) -> "JointSetpoint":
        """Setpoint in the robot's `state`, `ticks` after this one, free of the state's
        rounding.

        A robot that received its command was at the joints `sent` (7,) one tick later;
        otherwise it keeps its acceleration.
        """
        reported = JointSetpoint.from_state(state)
        position = self.position
        if (
            largest_difference(reported.acceleration, self.acceleration)
            > ACCELERATION_ROUNDING
        ):
            position = sent
            ticks = max(ticks - 1, 0)
        for ago in range(ticks):
            position = [
                angle + TICK * (rate - ago * TICK * acceleration)
                for angle, rate, acceleration in zip(
                    position, reported.rate, reported.acceleration, strict=True
                )
            ]
        if largest_difference(reported.position, position) > ROUNDING:
            return reported
        return reported._replace(position=position)


class RateLimits(NamedTuple):
    """Limits on changes of a joint's rate: acceleration [rad/s^2] and jerk [rad/s^3].

    `gain` [1/s] is from an error of the rate to the acceleration.
    """

    acceleration: float
    jerk: float
    gain: float


GENTLE = RateLimits(acceleration=1.5, jerk=50.0, gain=12.0)
HARD = RateLimits(acceleration=8.0, jerk=2000.0, gain=30.0)
"""For a stop out of contact; its gain is stable with commands lost for 15 ms."""


class JointMotion:
    """Generator of joint setpoints (7,) [rad] on the way to a goal, one per tick.

    It follows a time-optimal plan while every command arrives, and a proportional
    controller afterwards. The plan reverses its acceleration at the last moment: a
    robot that misses commands overshoots and oscillates about the goal. The
    controller's speed is proportional to the remaining distance, with a time constant
    ten times longer than any such delay.
    """

    def __init__(self, state: Any, goal: Numbers, share: float) -> None:
        """Plan from rest in `state` to rest at joints `goal` (7,) [rad], at `share` of
        speed.
        """
        start = list(state.q_d)
        self._planner = ruckig.Ruckig(AXES, TICK)
        self._input = _planner_input(start, goal, share)
        self._output = ruckig.OutputParameter(AXES)
        self._goal: Numbers | None = goal
        self._speed = share * JOINT_SPEED
        self._limits = GENTLE._replace(acceleration=share * GENTLE.acceleration)
        self._time = state.time.to_sec()
        self._setpoint = JointSetpoint(start, [0.0] * AXES, [0.0] * AXES)
        self._sent = start
        self._planned = True
        self._missed = False

    @property
    def arrived(self) -> bool:
        """Whether the setpoints have reached the goal."""
        if not self._missed:
            return not self._planned
        resting = max(map(abs, self._setpoint.rate)) < REST_RATE
        if self._goal is None:
            return resting
        return (
            resting
            and largest_difference(self._setpoint.position, self._goal) < GOAL_TOLERANCE
        )

    def tick(self) -> Numbers:
        """Next setpoint (7,) [rad] of all joints; ArmFault where no motion leads to the
        goal.
        """
        self._sent = (
            self._stepwise_setpoint() if self._missed else self._planned_setpoint()
        )
        return self._sent

    def update(self, state: Any) -> None:
        """Continue from the setpoint in the robot's `state` where it is not the one
        last sent.

        The state is rounded: 1e-7 rad in one tick is 0.1 rad/s^2. The exact setpoint
        follows from the last command that the robot received, as it keeps its
        acceleration without one.
        """
        time = state.time.to_sec()
        ticks = round((time - self._time) / TICK)
        self._time = time
        off = largest_difference(state.q_d, self._sent) > ROUNDING
        self._missed = self._missed or ticks != 1 or off
        self._setpoint = self._setpoint.followed_by(state, self._sent, ticks)

    def brake(self, limits: RateLimits = GENTLE) -> None:
        """From now on brake to rest, wherever that is, within `limits`."""
        self._goal = None
        self._limits = limits
        self._input.max_acceleration = [limits.acceleration] * AXES
        self._input.max_jerk = [limits.jerk] * AXES
        self._input.control_interface = ruckig.ControlInterface.Velocity
        self._input.target_velocity = self._input.target_acceleration = [0.0] * AXES

    def _planned_setpoint(self) -> Numbers:
        """Next setpoint (7,) [rad] of the time-optimal plan."""
        result = self._planner.update(self._input, self._output)
        if result not in (ruckig.Result.Working, ruckig.Result.Finished):
            raise ArmFault(Cause.COMMAND, "no motion leads to these joints")
        self._planned = bool(result == ruckig.Result.Working)
        self._output.pass_to_input(self._input)
        setpoint: Numbers = self._output.new_position
        return setpoint

    def _stepwise_setpoint(self) -> Numbers:
        """Next setpoint (7,) [rad] by proportional control: speeds proportional to the
        distance.
        """
        rates = [0.0] * AXES
        if self._goal is not None:
            away = np.subtract(self._goal, self._setpoint.position).tolist()
            fastest = APPROACH_GAIN * max(map(abs, away))
            gain = APPROACH_GAIN * min(1.0, self._speed / fastest) if fastest else 0.0
            rates = [gain * distance for distance in away]  # one gain for all: straight
        return [
            self._next_position(*joint)
            for joint in zip(*self._setpoint, rates, strict=True)
        ]

    def _next_position(
        self, position: float, rate: float, acceleration: float, target_rate: float
    ) -> float:
        """Setpoint [rad] of one joint that approaches `target_rate` [rad/s]."""
        target = _clip(
            self._limits.gain * (target_rate - rate), self._limits.acceleration
        )
        acceleration += _clip(target - acceleration, self._limits.jerk * TICK)
        return position + TICK * (rate + TICK * acceleration)


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
    setpoints = JointMotion(state, joints, share)
    objection = ""
    while not (setpoints.arrived and max(map(abs, state.dq_d)) < REST_RATE):
        if not objection and until(state):
            setpoints.brake()
        robot.write_joints(motion, setpoints.tick())
        state = robot.read(motion)
        setpoints.update(state)
        objection = objection or guard.objection(state)
        if objection:
            setpoints.brake(HARD)
    robot.write_joints(motion, list(state.q_d), last=True)
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
        # whether `_setpoint` predicts the robot a tick after `_time`
        self._ahead = False
        self._setpoint: JointSetpoint | None = None
        self._sent: Numbers = []
        self._sent_pose: Array | None = None
        self._past_poses: list[Array] = []  # setpoints (4, 4), the newest first
        self._time = 0.0
        # rad, rad, rad/s: elbow at the start, its commanded angle and rate
        self._initial_elbow = self._elbow = self._elbow_rate = 0.0

    def start_poses(self) -> Any:
        """Start a motion commanded by hand poses; the elbow (joint 3) keeps its present
        angle.
        """
        self._setpoint = None
        self._sent_pose = None
        self._ahead = False
        return self._robot.start_joints()

    def read(self, motion: Any) -> CartesianState:
        """Next state of the robot in `motion`, with the hand's setpoint from that of
        the joints.
        """
        state = self._robot.read(motion)
        time = state.time.to_sec()
        if self._setpoint is None:
            setpoint = JointSetpoint.from_state(state)
            self._resynchronise(setpoint)
            self._sent = setpoint.position
            self._initial_elbow = self._elbow
        else:
            ticks = max(round((time - self._time) / TICK), 0)
            self._advance(self._setpoint.followed_by(state, self._sent, ticks), ticks)
        self._time = time
        pose, last_pose, pose_before = self._past_poses
        twist = _twist(pose, last_pose)
        twist_change = (twist - _twist(last_pose, pose_before)) / TICK
        return CartesianState(
            state=state,
            seconds=time + TICK * self._ahead,
            O_T_EE_c=pose.T.ravel().tolist(),
            O_dP_EE_c=twist.tolist(),
            O_ddP_EE_c=twist_change.tolist(),
        )

    def _advance(self, setpoint: JointSetpoint, ticks: int) -> None:
        """Continue from `setpoint`, `ticks` after the last; predict a robot on its own
        clock.
        """
        off = largest_difference(setpoint.position, self._sent)
        if self._sent_pose is not None and ticks == 1 and off < ROUNDING:
            self._setpoint = setpoint
            self._past_poses = [self._sent_pose, *self._past_poses[:2]]
            return
        self._ahead = self._own_clock
        self._resynchronise(setpoint.after_a_tick() if self._ahead else setpoint)

    def _resynchronise(self, setpoint: JointSetpoint) -> None:
        """Set the joints' setpoint, the elbow's motion and past hand poses to
        `setpoint`.
        """
        self._setpoint = setpoint
        self._elbow = setpoint.position[ELBOW_JOINT]
        self._elbow_rate = setpoint.rate[ELBOW_JOINT]
        self._past_poses = _past_poses(setpoint)

    def write_pose(self, motion: Any, pose: Numbers, *, last: bool = False) -> None:
        """Command the joints that bring the hand to `pose`, a column-major 4x4 matrix
        (16,).

        Raises ArmFault before the first state.
        """
        if self._setpoint is None:
            raise ArmFault(
                Cause.COMMAND, "a pose was sent before the first state was read"
            )
        target = pose_from_columns(pose)
        joints = self._joints_at(target, self._setpoint)
        if (
            self._ahead
            and not self._await_prediction(motion, self._setpoint)
            and not last
        ):
            return
        self._sent = joints
        self._sent_pose = target
        self._robot.write_joints(motion, joints, last=last)

    def _joints_at(self, target: Array, setpoint: JointSetpoint) -> Numbers:
        """Joints (7,) [rad] with the hand at `target` (4, 4), a tick after
        `setpoint`.
        """
        # one Newton step is exact there
        near = np.array(setpoint.after_a_tick().position)
        # critically damped return of the elbow
        restoring_rate = (
            ELBOW_GAIN * (self._initial_elbow - self._elbow) - 2.0 * self._elbow_rate
        )
        self._elbow_rate += TICK * ELBOW_GAIN * restoring_rate
        self._elbow += TICK * self._elbow_rate
        near_pose, jacobian = pose_and_jacobian(near)
        joints = near + joint_step(near, near_pose, jacobian, target, self._elbow)
        return list(joints.tolist())

    def _await_prediction(self, motion: Any, predicted: JointSetpoint) -> bool:
        """Read the robot's next state; False, and continue from it, where it is not
        `predicted`.
        """
        state = self._robot.read_queued(motion)
        predicted_time = self._time + TICK
        self._time = state.time.to_sec()
        self._ahead = False
        off = largest_difference(predicted.position, state.q_d)
        if round((self._time - predicted_time) / TICK) == 0 and off < ROUNDING:
            return True
        self._setpoint = JointSetpoint.from_state(state)
        self._sent = self._setpoint.position
        self._sent_pose = None
        return False


def largest_difference(first: Numbers, second: Numbers) -> float:
    """Largest |a - b| over the entries a, b at the same place of two lists of one
    length.
    """
    return max(abs(a - b) for a, b in zip(first, second, strict=True))


def _past_poses(setpoint: JointSetpoint) -> list[Array]:
    """Hand poses (4, 4) [m] in the base now, one tick ago and two ticks ago."""
    position, rate, acceleration = (np.array(part) for part in setpoint)
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


def _planner_input(
    start: Numbers, goal: Numbers, share: float
) -> ruckig.InputParameter:
    """Ruckig's input from rest at `start` to rest at `goal` (7,) [rad], straight in
    joint space.

    Speed and acceleration are a `share` of the full ones; the jerk is not scaled.
    """
    planner = ruckig.InputParameter(AXES)
    planner.synchronization = ruckig.Synchronization.Phase  # straight
    planner.current_position = start
    planner.target_position = goal
    planner.current_velocity = planner.current_acceleration = [0.0] * AXES
    planner.max_velocity = [share * JOINT_SPEED] * AXES
    planner.max_acceleration = [share * GENTLE.acceleration] * AXES
    planner.max_jerk = [GENTLE.jerk] * AXES
    return planner


def _clip(value: float, limit: float) -> float:
    """`value` bounded to the range from -`limit` to `limit`."""
    return min(max(value, -limit), limit)
