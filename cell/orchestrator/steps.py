"""Building blocks of phases: generators that receive snapshots and yield commands.

Returning an event ends the state. A phase waits by yielding, so that one loop with its monitors and
its record serves every motion.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from math import cos, sin

from cell.devices.fold_path import TURNING
from cell.orchestrator.snapshot import CloseHand, Command, Drive, Hold, MoveTo, OpenHand, Snapshot
from cell.orchestrator.states import Event
from drivers.types import Frame, Pose, Velocity
from policies.policy import Decision

Phase = Generator[Command, Snapshot, Event]
Motion = Generator[Command, Snapshot, Snapshot]

SETTLE = 0.3  # s for strip and image to come to rest
POSE_TOLERANCE = 0.002  # m, rad: how near a finished move must have come


@dataclass(frozen=True, slots=True)
class StillPicture:
    """An image taken at rest: its time [s], and the gripper's pose."""

    time: float
    frame: Frame
    gripper: Pose


def wait_for(condition: Callable[[Snapshot], bool]) -> Motion:
    """Hold until `condition` is true; returns the snapshot that satisfied it."""
    snapshot = yield Hold()
    while not condition(snapshot):
        snapshot = yield Hold()
    return snapshot


def pause(duration: float) -> Motion:
    """Hold for `duration` [s]."""
    snapshot = yield Hold()
    end = snapshot.time + duration
    return (yield from wait_for(lambda now: now.time >= end))


def move(pose: Pose) -> Motion:
    """Move to rest at `pose`."""
    snapshot = yield MoveTo(pose)
    snapshot = yield MoveTo(pose)
    while not is_at(snapshot, pose):
        snapshot = yield MoveTo(pose)
    return snapshot


def still_picture(*, settle: bool = True) -> "Generator[Command, Snapshot, StillPicture]":
    """Wait until arm, strip and image are at rest; returns the first image taken after that.

    Without `settle` they are assumed to be, and the next image is used.
    """
    still = (yield from pause(SETTLE if settle else 0.0)).time
    while True:
        snapshot = yield Hold()
        frame = snapshot.view.frame
        if snapshot.view.fresh and frame is not None and frame.stamp > still:
            return StillPicture(snapshot.time, frame, snapshot.arm.pose)


def open_hand() -> Motion:
    """Open the fingers and wait for them."""
    yield OpenHand()
    return (yield from _fingers_rest())


def close_hand() -> Motion:
    """Close the fingers and wait for them."""
    yield CloseHand()
    return (yield from _fingers_rest())


def _fingers_rest() -> Motion:
    yield Hold()
    return (yield from wait_for(lambda now: not now.hand.moving))


def rotate_hand(pitch: float) -> "Generator[Command, Snapshot, Pose]":
    """Turn the hand to `pitch` [rad] in place; returns the pose before the turn.

    An arm that turns its hand while it reaches far can run into the limits of its joints.
    """
    start = (yield Hold()).arm.commanded
    yield from move(Pose(start.x, start.z, pitch))
    return start


def is_at(snapshot: Snapshot, pose: Pose) -> bool:
    """Whether the arm is at rest at `pose`."""
    return not snapshot.arm.moving and _distance(snapshot.arm.commanded, pose) <= POSE_TOLERANCE


def _distance(a: Pose, b: Pose) -> float:
    return max(abs(a.x - b.x), abs(a.z - b.z), abs(a.pitch - b.pitch))


def drive(decision: Decision, pitch_rate: float) -> Drive:
    """The command that carries out a `decision` on one strip, turning at `pitch_rate` [rad/s].

    The rate is bounded: after a late tick the correction of the pitch may ask for more than an arm
    gives.
    """
    rate = min(max(pitch_rate, -TURNING), TURNING)
    phi, speed = float(decision.direction[0]), float(decision.speed[0])
    return Drive(Velocity(speed * cos(phi), speed * sin(phi), rate))
