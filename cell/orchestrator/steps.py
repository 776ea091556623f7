"""One state of a run as a generator: it is sent what the cell senses, yields what to command.

Returning an event ends the state. Everything a phase waits for, it waits for by yielding, so
that one loop with its monitors and its record serves every motion.
"""

from collections.abc import Callable, Generator

from cell.orchestrator.snapshot import CloseHand, Command, Hold, MoveTo, OpenHand, Senses
from cell.orchestrator.states import Event
from drivers.types import Pose

Phase = Generator[Command, Senses, Event]
Motion = Generator[Command, Senses, Senses]

REACHED = 0.002  # m, rad: how near a finished move must have come


def wait_for(condition: Callable[[Senses], bool]) -> Motion:
    """Hold until `condition`; returns the senses that fulfilled it."""
    senses = yield Hold()
    while not condition(senses):
        senses = yield Hold()
    return senses


def pause(duration: float) -> Motion:
    """Hold for `duration` [s]."""
    senses = yield Hold()
    end = senses.time + duration
    return (yield from wait_for(lambda now: now.time >= end))


def move(pose: Pose) -> Motion:
    """Move to rest at `pose`."""
    senses = yield MoveTo(pose)
    senses = yield MoveTo(pose)
    while senses.arm.moving or _distance(senses.arm.commanded, pose) > REACHED:
        senses = yield MoveTo(pose)
    return senses


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
