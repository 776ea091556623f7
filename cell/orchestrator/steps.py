"""Motions and waits of which phases consist: generators from snapshots to commands.

Returning an event ends the state. A phase waits by yielding, so that one loop with its
monitors and its record serves every motion.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from math import cos, sin

import numpy as np

from cell.base.devices.fold_path import TURNING
from cell.orchestrator.snapshot import (
    CloseHand,
    Command,
    Drive,
    Hold,
    MoveTo,
    OpenHand,
    Snapshot,
)
from cell.orchestrator.states import Trigger
from drivers.base.types import Frame, Pose, Velocity
from policies.policy import Decision

Phase = Generator[Command, Snapshot, Trigger]
Motion = Generator[Command, Snapshot, Snapshot]

SETTLE = 0.3  # s for strip and image to come to rest
POSE_TOLERANCE = 0.002  # m, rad: how near a finished move must have come


@dataclass(frozen=True, slots=True)
class StillPicture:
    """Image `frame` taken at rest, the `time` [s] at which it arrived, and the pose of
    the `gripper`.
    """

    time: float
    frame: Frame
    gripper: Pose


def wait_for(condition: Callable[[Snapshot], bool]) -> Motion:
    """Keep the arm at rest until `condition` holds; returns the snapshot that satisfied
    it.
    """
    snapshot = yield Hold()
    while not condition(snapshot):
        snapshot = yield Hold()
    return snapshot


def pause(duration: float) -> Motion:
    """Keep the arm at rest for `duration` [s]."""
    snapshot = yield Hold()
    end = snapshot.time + duration
    return (yield from wait_for(lambda now: now.time >= end))


def move(pose: Pose) -> Motion:
    """Move the gripper to rest at `pose`."""
    snapshot = yield MoveTo(pose)
    snapshot = yield MoveTo(pose)
    while not is_at(snapshot, pose):
        snapshot = yield MoveTo(pose)
    return snapshot


def still_picture(
    settling: float = SETTLE,
) -> Generator[Command, Snapshot, StillPicture]:
    """Wait until the arm has rested for `settling` [s], and return the first image
    taken after that.
    """
    at_rest = yield from pause(settling)
    while True:
        snapshot = yield Hold()
        frame = snapshot.view.frame
        if snapshot.view.fresh and frame is not None and frame.stamp > at_rest.time:
            return StillPicture(snapshot.time, frame, snapshot.arm.pose)


def open_hand(width: float | None = None) -> Motion:
    """Open the fingers, to `width` [m] or as wide as they go, and wait until they
    rest.
    """
    return _move_fingers(OpenHand(width))


def close_hand() -> Motion:
    """Close the fingers and wait until they rest."""
    return _move_fingers(CloseHand())


def _move_fingers(command: OpenHand | CloseHand) -> Motion:
    """Give the hand its `command` and wait until the fingers rest."""
    yield command
    yield Hold()
    return (yield from wait_for(lambda now: not now.hand.moving))


def rotate_hand(pitch: float) -> Generator[Command, Snapshot, Pose]:
    """Rotate the hand to `pitch` [rad] without moving the gripper; returns the pose
    before the rotation.

    An arm that turns its hand while it reaches far can run into the limits of its
    joints.
    """
    start = (yield Hold()).arm.commanded
    yield from move(Pose(start.x, start.z, pitch))
    return start


def is_at(snapshot: Snapshot, pose: Pose) -> bool:
    """Whether the arm is at rest at `pose`, within POSE_TOLERANCE."""
    error = np.abs(snapshot.arm.commanded.as_array() - pose.as_array()).max()
    return not snapshot.arm.moving and bool(error <= POSE_TOLERANCE)


def drive(decision: Decision, pitch_rate: float) -> Drive:
    """Velocity command for a `decision` on one strip, with a rotation at `pitch_rate`
    [rad/s].

    The rate is bounded: after a late tick the correction of the pitch may ask for more
    than an arm gives.
    """
    rate = min(max(pitch_rate, -TURNING), TURNING)
    direction = float(decision.direction[0])
    speed = float(decision.speed[0])
    return Drive(Velocity(speed * cos(direction), speed * sin(direction), rate))
