"""A step of a block of strips: tried whole, then in parts where a lane did not converge.

Only abrupt events need parts: a gripper that starts at full speed beside a straight strip
makes it buckle within one step.
"""

import math
from typing import Any

import numpy as np

from drivers.strip.rod import layout as at
from drivers.strip.rod.compiled import kernel
from drivers.strip.rod.lanes import anywhere, choose, load, pick, put, store
from drivers.strip.rod.march import attempt
from drivers.strip.rod.newton import FIRST

PARTS = (16, 256)


@kernel
def grip(state: Any, nature: Any, lane: int, pose: Any) -> None:
    """Put one lane's grasped edge to x, z, its ghost one segment on along the pitch."""
    row = state.shape[0] - 2
    span = pick(nature, row, at.SPAN, lane)
    put(state, row, at.X, lane, pose[0])
    put(state, row, at.Z, lane, pose[1])
    put(state, row + 1, at.X, lane, pose[0] + span * math.cos(pose[2]))
    put(state, row + 1, at.Z, lane, pose[1] + span * math.sin(pose[2]))


@kernel
def place(
    state: Any, nature: Any, strips: Any, alive: Any, held: Any, poses: Any, share: float
) -> None:
    """Put each living lane's grip to `share` of the way from where it is `held` to its pose."""
    pose = np.empty(3)
    for lane in range(len(strips)):
        if pick(alive, 0, 0, lane) > 0.0:
            i = strips[lane]
            for c in range(3):
                pose[c] = poses[i, c] - (1.0 - share) * (poses[i, c] - held[i, c])
            grip(state, nature, lane, pose)


@kernel
def rewind(state: Any, gate: Any) -> None:
    """Undo a failed step where `gate`."""
    for r in range(FIRST, state.shape[0] - 2):
        for axis in range(at.EPS):
            now = load(state, r, at.X + axis)
            store(state, r, at.X + axis, choose(gate, load(state, r, at.X1 + axis), now))
    for r in range(state.shape[0]):
        tension = load(state, r, at.TENSION)
        store(state, r, at.TENSION, choose(gate, 0.0 * gate, tension))


@kernel
def copy(source: Any, first: int, count: int, target: Any, to: int, gate: Any) -> None:
    """`count` fields of `source` from `first` to those of `target` from `to`, where `gate`."""
    for r in range(target.shape[0]):
        for c in range(count):
            old = load(target, r, to + c)
            store(target, r, to + c, choose(gate, load(source, r, first + c), old))


@kernel
def step(
    block: Any, work: Any, band: Any, held: Any, poses: Any, h: float, omega: float, again: float
) -> Any:
    """One step of a block to `poses` (n, 3); the lanes that did not converge in any way."""
    nature, state, strips, alive = block
    place(state, nature, strips, alive, held, poses, 1.0)
    gate = attempt(nature, state, work, band, h, omega, load(alive, 0, 0))
    if not anywhere(gate):
        return gate
    rewind(state, gate)
    start = state.copy()
    for parts in PARTS:
        failed = in_parts(block, work, band, held, poses, h, again, gate, parts)
        if not anywhere(failed):
            copy(start, at.X, at.EPS, state, at.X1, gate)
            copy(start, at.EPS, 1, state, at.EPS1, gate)
            break
        copy(start, 0, at.STATE, state, 0, gate)
    return failed


@kernel
def in_parts(
    block: Any,
    work: Any,
    band: Any,
    held: Any,
    poses: Any,
    h: float,
    again: float,
    gate: Any,
    parts: int,
) -> Any:
    """A step of the lanes `gate` as `parts` equal ones from rest of history; lanes that failed."""
    nature, state, strips, alive = block
    failed = gate
    for part in range(parts):
        place(state, nature, strips, alive, held, poses, (part + 1) / parts)
        omega = again if part > 0 else 0.0
        failed = attempt(nature, state, work, band, h / parts, omega, gate)
        if anywhere(failed):
            break
    return failed
