"""A step of a block of strips, repeated in substeps where a lane fails to converge.

Only abrupt events need substeps: a gripper that starts at full speed beside a straight strip makes
it buckle within one step.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from drivers.strip.rod import layout as at
from drivers.strip.rod.compiled import kernel
from drivers.strip.rod.lanes import anywhere, choose, load, pick, put, store
from drivers.strip.rod.march import attempt

STEP_PARTS = (16, 256)  # substeps of a failed step: first try, second try


class Grips(NamedTuple):
    """Grip poses of all strips before and after a step, and the strips in one block's lanes.

    `strips` (LANE_COUNT,) are the strips that the lanes hold, `alive` whether each is still
    simulated; `held` (n, 3) are the poses before the step, `poses` (n, 3) those after it.
    """

    strips: Any
    alive: Any
    held: Any
    poses: Any


class Pace(NamedTuple):
    """Size `h` [s] of a step, its BDF2 step ratios, and the `tolerance` [rad] of Newton's method.

    `omega` is the ratio of the step to the last one, `next_omega` that of equal steps after it: 1,
    or 0 for backward Euler.
    """

    h: float
    omega: float
    next_omega: float
    tolerance: float


@kernel
def place_grip(block: Any, lane: int, pose: Any) -> None:
    """Move one lane's grasped edge to `pose` (x, z, pitch), and its ghost node along the pitch."""
    row = block.state.shape[0] - 2
    span = pick(block.nature, row, at.SPAN, lane)
    put(block.state, row, at.X, lane, pose[0])
    put(block.state, row, at.Z, lane, pose[1])
    put(block.state, row + 1, at.X, lane, pose[0] + span * math.cos(pose[2]))
    put(block.state, row + 1, at.Z, lane, pose[1] + span * math.sin(pose[2]))


@kernel
def place_grips(block: Any, grips: Any, share: float) -> None:
    """Move each active lane's grip to the pose at `share` of the step, unless the end is free."""
    if block.last == block.state.shape[0] - 2:
        return
    pose = np.empty(3)
    for lane in range(len(grips.strips)):
        if pick(grips.alive, 0, 0, lane) > 0.0:
            i = grips.strips[lane]
            for c in range(3):
                goal = grips.poses[i, c]
                pose[c] = goal - (1.0 - share) * (goal - grips.held[i, c])
            place_grip(block, lane, pose)


@kernel
def rewind(block: Any, gate: Any) -> None:
    """Restore the state before a failed step in the lanes `gate`."""
    state = block.state
    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        for field in range(at.EPS):
            now = load(state, r, at.X + field)
            store(state, r, at.X + field, choose(gate, load(state, r, at.X1 + field), now))
    for r in range(state.shape[0]):
        store(state, r, at.TENSION, choose(gate, 0.0, load(state, r, at.TENSION)))


@kernel
def copy_fields(source: Any, fields: Any, target: Any, to: int, gate: Any) -> None:
    """Copy fields first to end - 1 of `source` to `target` from field `to` on, in lanes `gate`."""
    first, end = fields
    for r in range(target.shape[0]):
        for c in range(end - first):
            old = load(target, r, to + c)
            store(target, r, to + c, choose(gate, load(source, r, first + c), old))


@kernel
def in_parts(block: Any, grips: Any, pace: Any, gate: Any, parts: int) -> Any:
    """Step the lanes `gate` in `parts` equal substeps without history; returns the failed lanes."""
    going = gate
    for part in range(parts):
        place_grips(block, grips, (part + 1) / parts)
        omega = pace.next_omega if part > 0 else 0.0
        going = going - attempt(block, pace.h / parts, omega, going, pace.tolerance)
        if not anywhere(going):
            break
    return gate - going


@kernel
def step(block: Any, grips: Any, pace: Any) -> Any:
    """Step a block to the next poses of its grips; returns the lanes that failed to converge.

    A lane that moved in substeps goes on with the history of one whole step; one that failed stays
    as it was.
    """
    place_grips(block, grips, 1.0)
    gate = attempt(block, pace.h, pace.omega, load(grips.alive, 0, 0), pace.tolerance)
    if not anywhere(gate):
        return gate
    rewind(block, gate)
    start = block.state.copy()
    for parts in STEP_PARTS:
        failed = in_parts(block, grips, pace, gate, parts)
        copy_fields(start, (0, start.shape[1]), block.state, 0, failed)
        moved = gate - failed  # their history is the state before the whole step
        copy_fields(start, (at.X, at.EPS), block.state, at.X1, moved)
        copy_fields(start, (at.EPS, at.FRICTION), block.state, at.EPS1, moved)
        if block.terms is not None:
            copy_fields(start, (at.MAXWELL, at.MAXWELL1), block.state, at.MAXWELL1, moved)
        gate = failed
        if not anywhere(gate):
            break
    place_grips(block, grips, 1.0)
    return gate
