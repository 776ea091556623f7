"""A block of strips along its grippers' paths: steps, measures, and the end at layer_touch."""

import math
from typing import Any

import numpy as np

from drivers.strip.rod import layout as at
from drivers.strip.rod.compiled import entry, kernel
from drivers.strip.rod.lanes import anywhere, pick, put
from drivers.strip.rod.measures import (
    along,
    desk_contact,
    fold_tip,
    layer_gap,
    rightmost,
)
from drivers.strip.rod.step import step

# What a step shows of a strip.
CONTACT_X, TIP_X, TIP_Z, HOLDING = range(4)
SHOWN = 4
# What is known of a strip: its limits, its smallest gap one step ago, and its touch.
HEIGHT, OPENING, TOUCH_GAP, LENGTH = range(4)
GAP, GAP_X, GAP_S = range(4, 7)
TIME, TOUCH_X, TOUCH_S = range(7, 10)
KNOWN = 10
# Outcome of `follow`.
FINE, NOT_CONVERGED, NOT_FINITE = range(3)


@kernel
def gather(state: Any, lane: int, x: Any, z: Any) -> None:
    """Midline of one lane into x, z (nodes,)."""
    for j in range(len(x)):
        x[j] = pick(state, j + 1, at.X, lane)
        z[j] = pick(state, j + 1, at.Z, lane)


@kernel
def measure(x: Any, z: Any, s: Any, known: Any, shown: Any, time: float, h: float) -> Any:
    """Observables of one strip into `shown`; whether its layers touched in this step."""
    shown[CONTACT_X] = desk_contact(x, z, known[HEIGHT])
    tip = rightmost(x)
    shown[TIP_X], shown[TIP_Z] = fold_tip(x, z, tip)
    height, index = layer_gap(x, z, tip, known[OPENING])
    here_x, here_s = along(x, index), along(s, index)
    touched = height <= known[TOUCH_GAP]
    if touched:
        settle_touch(known, height, here_x, here_s, time, h)
    known[GAP], known[GAP_X], known[GAP_S] = height, here_x, here_s
    return touched


@kernel
def settle_touch(known: Any, height: float, x: float, s: float, time: float, h: float) -> None:
    """layer_touch interpolated to where the gap fell through its limit."""
    share = 1.0
    if math.isfinite(known[GAP]) and known[GAP] > known[TOUCH_GAP]:
        share = (known[GAP] - known[TOUCH_GAP]) / (known[GAP] - height)
        x = known[GAP_X] + share * (x - known[GAP_X])
        s = known[GAP_S] + share * (s - known[GAP_S])
    known[TIME], known[TOUCH_X], known[TOUCH_S] = time - h + share * h, x, s


@kernel
def observe(
    state: Any,
    work: Any,
    strips: Any,
    alive: Any,
    arc: Any,
    known: Any,
    shown: Any,
    time: float,
    h: float,
) -> None:
    """Measure every living lane; a strip whose layers touched lives no longer."""
    x, z = np.empty(state.shape[0] - 2), np.empty(state.shape[0] - 2)
    for lane in range(len(strips)):
        if pick(alive, 0, 0, lane) > 0.0:
            i = strips[lane]
            gather(state, lane, x, z)
            shown[i, HOLDING] = -pick(state, 1, at.TENSION, lane)
            if measure(x, z, arc[i], known[i], shown[i], time, h):
                put(alive, 0, 0, lane, 0.0)


@kernel
def diagnose(state: Any, lanes: int) -> int:
    """Why a step failed: NOT_FINITE or NOT_CONVERGED."""
    for lane in range(lanes):
        for r in range(state.shape[0]):
            finite = math.isfinite(pick(state, r, at.X, lane) + pick(state, r, at.Z, lane))
            if not finite:
                return NOT_FINITE
    return NOT_CONVERGED


@kernel
def any_alive(alive: Any, lanes: int) -> bool:
    """Whether a lane of the block still simulates."""
    for lane in range(lanes):
        if pick(alive, 0, 0, lane) > 0.0:
            return True
    return False


@kernel
def record(state: Any, strips: Any, alive: Any, shapes: Any) -> None:
    """Midlines of the living lanes into shapes (n, nodes, 2)."""
    for lane in range(len(strips)):
        if pick(alive, 0, 0, lane) > 0.0:
            shape = shapes[strips[lane]]
            gather(state, lane, shape[:, 0], shape[:, 1])


@kernel
def hold(held: Any, poses: Any, strips: Any) -> None:
    """Remember where the grips of a block's strips are now."""
    for i in strips:
        if i < len(held):
            held[i] = poses[i]


@entry
def follow(
    nature: Any,
    state: Any,
    work: Any,
    band: Any,
    strips: Any,
    alive: Any,
    known: Any,
    arc: Any,
    held: Any,
    poses: Any,
    shown: Any,
    shapes: Any,
    every: int,
    start: float,
    h: float,
    omega: float,
    again: float,
) -> Any:
    """Blocks of strips along poses (k, n, 3), one step of h [s] each, from time `start`.

    nature, state (blocks, rows, fields[, WIDTH]); strips, alive: which strip each lane holds and
    whether it simulates; held (n, 3): poses of the grips so far; shown (k, n, SHOWN); shapes
    (k // every, n, nodes, 2), for every `every`th step, or empty. `omega`
    is the first step over the one before, `again` that of the others. Returns the outcome, and
    when it is not FINE the block and the step.
    """
    lanes = strips.shape[1]
    for b in range(len(nature)):
        ratio = omega
        block = (nature[b], state[b], strips[b], alive[b])
        for k in range(len(poses)):
            if not any_alive(alive[b], lanes):
                break
            unsolved = step(block, work, band, held, poses[k], h, ratio, again)
            if anywhere(unsolved):
                return diagnose(state[b], lanes), b, k
            time = start + (k + 1) * h
            if len(shapes) > 0 and (k + 1) % every == 0:
                record(state[b], strips[b], alive[b], shapes[(k + 1) // every - 1])
            observe(state[b], work, strips[b], alive[b], arc, known, shown[k], time, h)
            hold(held, poses[k], strips[b])
            ratio = again
    return FINE, 0, 0
