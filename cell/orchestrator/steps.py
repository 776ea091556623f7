"""One state of a run as a generator: it is sent snapshots, yields commands.

Returning an event ends the state. Everything a phase waits for, it waits for by yielding, so
that one loop with its monitors and its record serves every motion.
"""

from collections.abc import Callable, Generator

from cell.orchestrator.snapshot import CloseHand, Command, Hold, MoveTo, OpenHand, Snapshot
from cell.orchestrator.states import Event
from drivers.types import Pose

Phase = Generator[Command, Snapshot, Event]
Motion = Generator[Command, Snapshot, Snapshot]

REACHED = 0.002  # m, rad: how near a finished move must have come


def wait_for(condition: Callable[[Snapshot], bool]) -> Motion:
    """Hold until `condition`; returns the snapshot that fulfilled it."""
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
    while snapshot.arm.moving or _distance(snapshot.arm.commanded, pose) > REACHED:
        snapshot = yield MoveTo(pose)
    return snapshot


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


def _distance(a: Pose, b: Pose) -> float:
    return max(abs(a.x - b.x), abs(a.z - b.z), abs(a.pitch - b.pitch))
