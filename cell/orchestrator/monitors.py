"""Monitors of each control cycle: slow an arm down as images age, or stop it with a
reason.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees, pi

import numpy as np

from cell.base.config.settings import MonitorLimits
from cell.orchestrator.snapshot import Command, Drive, Hold, MoveTo, Snapshot
from cell.orchestrator.states import TERMINAL, State
from cell.record.header import DEVICES, OUTCOMES
from drivers.base.errors import Fault, in_mm, in_ms
from drivers.base.installation import MotionLimits, Workspace
from drivers.base.types import Velocity
from drivers.franka.obstacles import require_clear
from drivers.strip.observation import LIFT_TRAVEL

MOVED_IMAGES = 2  # images in a row that show the scene shifted before the arm stops
USUAL_AGE = 0.7  # share of the allowed image age below which the speed is not reduced


@dataclass(frozen=True, slots=True)
class Rules:
    """Limits that the monitors enforce; `desk` is x [m] of the desk's end, 0 without a
    hand.
    """

    limits: MonitorLimits
    workspace: Workspace
    desk: float = 0.0
    motion: MotionLimits = field(default_factory=MotionLimits)

    @property
    def tracking_turn(self) -> float:
        """Allowed tracking error of the pitch [rad], derived from that of the position.

        The rotation of the hand at full rate while it moves by the allowed position
        error at full speed, at most that of a lift over the same distance.
        """
        axes = self.motion
        ratio = axes.pitch.velocity / max(axes.x.velocity, axes.z.velocity)
        return self.limits.tracking_error * min(ratio, pi / 2 / LIFT_TRAVEL)


Check = Callable[[Snapshot, Rules], str | None]


@dataclass(frozen=True, slots=True)
class Monitor:
    """Named safety check, active in `states`, that returns a reason to stop the arm, or
    None.
    """

    name: str
    states: frozenset[State]
    check: Check


def _stale(what: str, age: float, limit: float, consequence: str = "") -> str | None:
    """Reason to stop where the `age` [s] of `what` exceeds `limit` [s], with its
    `consequence`.
    """
    if abs(age) <= limit:  # a stamp of the future would hide how old all later ones are
        return None
    return f"{what} is {in_ms(age)} old, allowed {in_ms(limit)}{consequence}"


def _arm_stale(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where the arm's newest state is too old."""
    return _stale(
        "the arm's state", snapshot.time - snapshot.arm.stamp, rules.limits.arm_age
    )


def _hand_stale(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where the hand's newest state is too old."""
    consequence = ": whether it still holds the strip is not known"
    age = snapshot.time - snapshot.hand.stamp
    return _stale("the hand's state", age, rules.limits.hand_age, consequence)


def _setpoint_expired(snapshot: Snapshot, _: Rules) -> str | None:
    """Reason to stop where the arm braked for want of a fresh velocity target."""
    if not snapshot.arm.expired:
        return None
    return "the arm braked by itself because no fresh velocity target reached it"


def _not_finite(snapshot: Snapshot, _: Rules) -> str | None:
    """Reason to stop where the measured pose is not finite."""
    if np.isfinite(snapshot.arm.pose.as_array()).all():
        return None
    return "the arm reports a pose that is not a number"


def _image_stale(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where the newest image is still too old after the arm waited for
    another.
    """
    limits = rules.limits
    view = snapshot.view
    if view.frame is None:
        return "the camera has delivered no image"
    age = snapshot.time - view.frame.stamp
    waiting = 0.0
    if view.stale_since is not None:
        waiting = snapshot.time - view.stale_since  # at rest: `slow_for_images`
    if waiting <= limits.image_wait and age >= -limits.image_age:
        return None
    return (
        f"the newest image is {in_ms(age)} old, allowed"
        f" {in_ms(limits.image_age)}, and the arm waited {in_ms(waiting)}"
        " for a younger one"
    )


def _image_frozen(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where too many successive images are identical."""
    identical = snapshot.view.identical
    limits = rules.limits
    if identical < limits.identical_images:
        return None
    return f"{identical} images in a row are identical: the camera is frozen"


def _reader_dead(snapshot: Snapshot, _: Rules) -> str | None:
    """Reason to stop where the reader of images has failed."""
    return snapshot.view.reader_failure or None


def _reading_overdue(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where measuring one image takes longer than is allowed."""
    since = snapshot.view.reading_since
    limit = rules.limits.reading
    if since is None or snapshot.time - since <= limit:
        return None
    return (
        f"an image is being read for {in_ms(snapshot.time - since)}, "
        f"allowed {in_ms(limit)}"
    )


def _low_confidence(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where the measurement's confidence was below its limit for too
    long.
    """
    limits = rules.limits
    view = snapshot.view
    if (
        view.doubtful_since is None
        or snapshot.time - view.doubtful_since <= limits.doubt
    ):
        return None
    confidence = 0.0 if view.measurement is None else view.measurement.confidence
    return (
        f"confidence in the images is {confidence:.2f}, below {limits.confidence:.2f} "
        f"for more than {limits.doubt:.1f} s"
    )


def _too_thick(snapshot: Snapshot, _: Rules) -> str | None:
    """Reason to stop where the layers rest without touching, as a strip thicker than
    stated does.
    """
    resting = snapshot.view.resting
    if not resting > 0:
        return None
    return (
        f"the layers rest {in_mm(resting, 1)} apart and do not touch: the strip is"
        " thicker than stated; correct its `thickness`, or look what lies between its"
        " layers"
    )


def _camera_moved(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where several images in a row show the scene shifted."""
    view = snapshot.view
    if view.moved < MOVED_IMAGES:
        return None
    return (
        f"the scene appears moved by {in_mm(view.shift, 1)} since the preflight,"
        f" allowed {in_mm(rules.limits.camera_shift, 1)}: the camera was touched;"
        " fasten it and calibrate again"
    )


def _overspeed(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where the gripper moves or turns faster than is allowed."""
    limits = rules.limits
    velocity = snapshot.arm.velocity
    allowed = limits.speed * limits.overspeed
    # here and in `_tracking_error` `not a <= b` instead of `a > b`: NaN must stop the
    # arm, too
    if not velocity.speed <= allowed:
        return (
            f"the gripper moves at {velocity.speed:.3f} m/s, allowed {allowed:.3f} m/s"
        )
    rate = abs(velocity.pitch_rate)
    allowed = rules.motion.pitch.velocity * limits.overspeed
    if not rate <= allowed:
        return f"the gripper turns at {rate:.2f} rad/s, allowed {allowed:.2f} rad/s"
    return None


def _tracking_error(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where measured and commanded pose are too far apart."""
    limits = rules.limits
    measured, commanded = snapshot.arm.pose, snapshot.arm.commanded
    error = np.hypot(measured.x - commanded.x, measured.z - commanded.z)
    if not error <= limits.tracking_error:
        return (
            f"the gripper is {in_mm(error, 1)} from where it was commanded, "
            f"allowed {in_mm(limits.tracking_error, 1)}"
        )
    turn = abs(measured.pitch - commanded.pitch)
    if not turn <= rules.tracking_turn:
        return (
            f"the gripper is turned by {degrees(turn):.1f} deg from where it was"
            f" commanded, allowed {degrees(rules.tracking_turn):.1f} deg"
        )
    return None


def _outside_workspace(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where the gripper is outside the workspace by more than the border
    [m].
    """
    pose = snapshot.arm.pose
    border = rules.limits.border
    x_low, x_high = rules.workspace.x
    z_low, z_high = rules.workspace.z
    inside_x = x_low - border <= pose.x <= x_high + border
    if inside_x and z_low - border <= pose.z <= z_high + border:
        return None
    return (
        f"the gripper is at x {pose.x:.3f}, z {pose.z:.3f} m, allowed x {x_low:.2f} to "
        f"{x_high:.2f}, z {z_low:.2f} to {z_high:.2f} m"
    )


def _force_too_large(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where the measured force on the gripper [N] is too large."""
    limits = rules.limits
    force = np.hypot(*snapshot.arm.force)
    if not force > limits.force:  # NaN: not measured
        return None
    return f"the gripper feels {force:.1f} N, allowed {limits.force:.1f} N"


def _grip_lost(snapshot: Snapshot, _: Rules) -> str | None:
    """Reason to stop where the hand no longer reports a grasp."""
    return None if snapshot.hand.grasped else "the hand no longer holds the strip"


def _too_long(what: str, duration: float, limit: float) -> str | None:
    """Reason to stop where `what` has lasted longer than `limit` [s]."""
    return (
        f"{what} lasts {duration:.0f} s, allowed {limit:.0f} s"
        if duration > limit
        else None
    )


def _state_overtime(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where the run has been in one state for too long."""
    duration = snapshot.time - snapshot.entered
    reason = _too_long(snapshot.state, duration, rules.limits.state_duration)
    return reason and f"{reason}; it waits for {_awaited(snapshot)}"


def _awaited(snapshot: Snapshot) -> str:
    """Text on what the run still waits for: the arm, the fingers, or an image and its
    measurement.
    """
    arm = snapshot.arm
    pose, commanded = arm.pose, arm.commanded
    if arm.moving:
        return (
            f"the arm, at x {1e3 * pose.x:.0f}, z {in_mm(pose.z)} and commanded"
            f" to x {1e3 * commanded.x:.0f}, z {in_mm(commanded.z)}"
        )
    return "the fingers" if snapshot.hand.moving else "an image and its reading"


def _overtime(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where the whole run lasts too long."""
    return _too_long("the run", snapshot.time, rules.limits.duration)


def _calibration_overtime(snapshot: Snapshot, rules: Rules) -> str | None:
    """Reason to stop where a calibration lasts too long."""
    duration = snapshot.time - snapshot.entered
    return _too_long("the calibration", duration, rules.limits.calibration)


_WAITING = frozenset({State.CALIBRATE})  # for people
_ALIVE = frozenset(State) - TERMINAL - {State.IDLE, State.STOPPING}
SEEING = _ALIVE - {State.PREFLIGHT, State.CALIBRATE}
_FOLDING = frozenset({State.LIFT, State.FOLD})
_HOLDING = frozenset({State.LIFT, State.FOLD, State.TOUCHED, State.LAY})

MONITORS: tuple[Monitor, ...] = (
    Monitor("arm_pose_not_finite", _ALIVE, _not_finite),
    Monitor("arm_state_stale", _ALIVE, _arm_stale),
    Monitor("hand_state_stale", _ALIVE, _hand_stale),
    Monitor("setpoint_expired", _FOLDING | {State.LAY}, _setpoint_expired),
    Monitor("overspeed", _ALIVE, _overspeed),
    Monitor("tracking_error", _ALIVE, _tracking_error),
    Monitor("workspace", _ALIVE, _outside_workspace),
    Monitor("force", _ALIVE, _force_too_large),
    Monitor("grip_lost", _HOLDING, _grip_lost),
    Monitor("image_stale", SEEING, _image_stale),
    Monitor("image_frozen", SEEING, _image_frozen),
    Monitor("image_reader_dead", SEEING, _reader_dead),
    Monitor("image_reading_overdue", SEEING, _reading_overdue),
    Monitor("camera_moved", _FOLDING, _camera_moved),
    Monitor("strip_too_thick", frozenset({State.FOLD}), _too_thick),
    Monitor("low_confidence", _FOLDING, _low_confidence),
    Monitor("state_overtime", _ALIVE - _WAITING, _state_overtime),
    Monitor("overtime", _ALIVE - _WAITING, _overtime),
    Monitor("calibration_overtime", _WAITING, _calibration_overtime),
)


def is_outcome(name: str) -> bool:
    """Whether `name` is that of an outcome: of a run that ended by itself, or of a
    fault.
    """
    return (
        name in OUTCOMES
        or name.startswith(DEVICES)
        or name in {m.name for m in MONITORS}
    )


def slow_for_images(
    command: Command, snapshot: Snapshot, limits: MonitorLimits
) -> Command:
    """Command with its speed reduced in proportion to the excess age of the newest
    image.

    At the allowed age, or where the newest image repeats the one before, a driven arm
    stands, and a move to a pose is held until a newer image arrives. Images of low
    confidence do not stop the arm: a bad view caused by the strip's pose ends as it
    moves on.
    """
    frame = snapshot.view.frame
    if frame is None or snapshot.state not in SEEING:
        return command
    age = snapshot.time - frame.stamp
    # of the speed
    share = (limits.image_age - age) / (1.0 - USUAL_AGE) / limits.image_age
    if snapshot.view.identical > 1:
        share = -1.0
    if isinstance(command, MoveTo) and share < 0.0:
        return Hold()
    if isinstance(command, Drive) and share < 1.0:
        share = max(share, 0.0)
        rate = command.velocity
        return Drive(
            Velocity(share * rate.vx, share * rate.vz, share * rate.pitch_rate)
        )
    return command


def check_all(snapshot: Snapshot, command: Command, rules: Rules) -> None:
    """Raise Fault for the first monitor that trips, or for a `command` beyond its
    limits.
    """
    for monitor in MONITORS:
        if snapshot.state in monitor.states:
            reason = monitor.check(snapshot, rules)
            if reason is not None:
                raise Fault(monitor.name, reason)
    _check_command(snapshot, command, rules)


def _check_command(snapshot: Snapshot, command: Command, rules: Rules) -> None:
    """Raise Fault for a commanded pose out of the workspace or in the desk, or too
    large a speed.

    The pitch rate and the path of a velocity are limited by the arm side and by the
    monitors.
    """
    speed = rules.limits.speed
    if isinstance(command, MoveTo):
        rules.workspace.check(command.pose)
        require_clear([snapshot.arm.commanded, command.pose], rules.desk)
    if isinstance(command, Drive):
        rate = command.velocity
        if not np.isfinite([rate.vx, rate.vz, rate.pitch_rate]).all():
            raise Fault(
                "command_refused", "a velocity that is not a number was asked for"
            )
        if rate.speed > speed:
            raise Fault(
                "command_refused",
                f"a velocity of {rate.speed:.3f} m/s was asked for, "
                f"allowed {speed:.3f} m/s",
            )
