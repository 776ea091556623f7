"""Monitors: a flat list, every one evaluated before every command; the first to trip stops."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from cell.senses import Command, Drive, MoveTo, Senses
from cell.states import TERMINAL, State
from drivers.errors import Fault
from drivers.settings import Settings


class MonitorLimits(Settings):
    """Limits of the monitors. Every one has a value; none can be switched off."""

    arm_age: float = Field(0.05, gt=0, le=0.5)  # s
    image_age: float = Field(0.25, gt=0, le=1.0)  # s
    identical_images: int = Field(4, ge=2, le=30)
    confidence: float = Field(0.3, gt=0, lt=1)
    doubt: float = Field(0.4, gt=0, le=2.0)  # s of low confidence before the arm stops
    overspeed: float = Field(1.25, ge=1.0, le=2.0)  # measured over allowed speed
    speed: float = Field(0.25, gt=0, le=1.0)  # m/s
    tracking_error: float = Field(0.015, gt=0, le=0.1)  # m, measured from commanded
    x_min: float = Field(-0.15, ge=-1.5, le=0)  # m, cell frame
    x_max: float = Field(0.85, gt=0, le=2.0)
    z_min: float = Field(-0.01, ge=-0.1, le=0)
    z_max: float = Field(0.50, gt=0, le=1.0)
    force: float = Field(20.0, gt=0, le=60.0)  # N on the gripper
    duration: float = Field(120.0, gt=0, le=900.0)  # s of a whole run
    state_duration: float = Field(60.0, gt=0, le=300.0)  # s in one state


Check = Callable[[Senses, MonitorLimits], str | None]


@dataclass(frozen=True, slots=True)
class Monitor:
    """A named check that runs in `states` and answers with a reason to stop, or None."""

    name: str
    states: frozenset[State]
    check: Check


def _arm_stale(senses: Senses, limits: MonitorLimits) -> str | None:
    age = senses.time - senses.arm.stamp
    if age <= limits.arm_age:
        return None
    return f"the arm's state is {1e3 * age:.0f} ms old, allowed {1e3 * limits.arm_age:.0f} ms"


def _setpoint_expired(senses: Senses, _: MonitorLimits) -> str | None:
    if not senses.arm.expired:
        return None
    return "the arm braked by itself because no fresh velocity target reached it"


def _not_finite(senses: Senses, _: MonitorLimits) -> str | None:
    if np.isfinite(senses.arm.pose.as_array()).all():
        return None
    return "the arm reports a pose that is not a number"


def _image_stale(senses: Senses, limits: MonitorLimits) -> str | None:
    if senses.frame is None:
        return "the camera has delivered no image"
    age = senses.time - senses.frame.stamp
    if age <= limits.image_age:
        return None
    return f"the newest image is {1e3 * age:.0f} ms old, allowed {1e3 * limits.image_age:.0f} ms"


def _image_frozen(senses: Senses, limits: MonitorLimits) -> str | None:
    if senses.identical < limits.identical_images:
        return None
    return f"{senses.identical} images in a row are identical: the camera is frozen"


def _low_confidence(senses: Senses, limits: MonitorLimits) -> str | None:
    if senses.doubtful_since is None or senses.time - senses.doubtful_since <= limits.doubt:
        return None
    seen = senses.sight.confidence if senses.sight is not None else 0.0
    return (
        f"confidence in the images is {seen:.2f}, below {limits.confidence:.2f} "
        f"for more than {limits.doubt:.1f} s"
    )


def _overspeed(senses: Senses, limits: MonitorLimits) -> str | None:
    allowed = limits.speed * limits.overspeed
    if senses.arm.velocity.speed <= allowed:
        return None
    return f"the gripper moves at {senses.arm.velocity.speed:.3f} m/s, allowed {allowed:.3f} m/s"


def _tracking(senses: Senses, limits: MonitorLimits) -> str | None:
    seen, asked = senses.arm.pose, senses.arm.commanded
    error = float(np.hypot(seen.x - asked.x, seen.z - asked.z))
    if error <= limits.tracking_error:
        return None
    return (
        f"the gripper is {1e3 * error:.1f} mm from where it was commanded, "
        f"allowed {1e3 * limits.tracking_error:.1f} mm"
    )


def _workspace(senses: Senses, limits: MonitorLimits) -> str | None:
    x, z = senses.arm.pose.x, senses.arm.pose.z
    if limits.x_min <= x <= limits.x_max and limits.z_min <= z <= limits.z_max:
        return None
    return (
        f"the gripper is at x {x:.3f}, z {z:.3f} m, allowed x {limits.x_min:.2f} to "
        f"{limits.x_max:.2f}, z {limits.z_min:.2f} to {limits.z_max:.2f} m"
    )


def _force(senses: Senses, limits: MonitorLimits) -> str | None:
    force = float(np.hypot(*senses.arm.force))
    if not force > limits.force:  # NaN: not measured
        return None
    return f"the gripper feels {force:.1f} N, allowed {limits.force:.1f} N"


def _grip_lost(senses: Senses, _: MonitorLimits) -> str | None:
    return None if senses.hand.grasped else "the hand no longer holds the strip"


def _state_overtime(senses: Senses, limits: MonitorLimits) -> str | None:
    spent = senses.time - senses.entered
    if spent <= limits.state_duration:
        return None
    return f"{senses.state} lasts {spent:.0f} s, allowed {limits.state_duration:.0f} s"


def _overtime(senses: Senses, limits: MonitorLimits) -> str | None:
    if senses.time <= limits.duration:
        return None
    return f"the run lasts {senses.time:.0f} s, allowed {limits.duration:.0f} s"


_ALIVE = frozenset(State) - TERMINAL - {State.IDLE, State.STOPPING}
_SEEING = _ALIVE - {State.PREFLIGHT, State.CALIBRATE}
_FOLDING = frozenset({State.LIFT, State.FOLD})
_HOLDING = frozenset({State.LIFT, State.FOLD, State.TOUCHED, State.LAY})

MONITORS: tuple[Monitor, ...] = (
    Monitor("arm_pose_not_finite", _ALIVE, _not_finite),
    Monitor("arm_state_stale", _ALIVE, _arm_stale),
    Monitor("setpoint_expired", _FOLDING | {State.LAY}, _setpoint_expired),
    Monitor("overspeed", _ALIVE, _overspeed),
    Monitor("tracking_error", _ALIVE, _tracking),
    Monitor("workspace", _ALIVE, _workspace),
    Monitor("force", _ALIVE, _force),
    Monitor("grip_lost", _HOLDING, _grip_lost),
    Monitor("image_stale", _SEEING, _image_stale),
    Monitor("image_frozen", _SEEING, _image_frozen),
    Monitor("low_confidence", _FOLDING, _low_confidence),
    Monitor("state_overtime", _ALIVE, _state_overtime),
    Monitor("overtime", _ALIVE, _overtime),
)


def check_all(senses: Senses, command: Command | None, limits: MonitorLimits) -> None:
    """Evaluate every monitor of this state and the command; raise Fault for the first to trip."""
    reasons = [
        (monitor.name, reason)
        for monitor in MONITORS
        if senses.state in monitor.states and (reason := monitor.check(senses, limits)) is not None
    ]
    asked = _refused(command, limits)
    if asked is not None:
        reasons.append(("command_refused", asked))
    if reasons:
        raise Fault(*reasons[0])


def _refused(command: Command | None, limits: MonitorLimits) -> str | None:
    if isinstance(command, MoveTo):
        pose = command.pose
        inside = limits.x_min <= pose.x <= limits.x_max and limits.z_min <= pose.z <= limits.z_max
        return (
            None if inside else f"a move to x {pose.x:.3f}, z {pose.z:.3f} m leaves the workspace"
        )
    if isinstance(command, Drive):
        rate = np.array([command.velocity.vx, command.velocity.vz, command.velocity.pitch_rate])
        if not np.isfinite(rate).all():
            return "the policy asked for a velocity that is not a number"
        if command.velocity.speed > limits.speed:
            return (
                f"a velocity of {command.velocity.speed:.3f} m/s was asked for, "
                f"allowed {limits.speed:.3f} m/s"
            )
    return None
