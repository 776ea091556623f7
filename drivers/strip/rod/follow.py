"""Stepping of blocks of strips along their grippers' paths, until their layers touch."""

import math
from typing import Any, NamedTuple

import numpy as np

from drivers.strip.rod import layout as at
from drivers.strip.rod.compiled import entry, kernel
from drivers.strip.rod.lanes import anywhere, lane_of, pick, put
from drivers.strip.rod.layout import Block
from drivers.strip.rod.measures import along, desk_contact, fold_tip, layer_gap, rightmost
from drivers.strip.rod.step import Grips, Pace, step

# Observables of a strip after a step.
CONTACT_X, TIP_X, TIP_Z, HOLDING, GRIP_X, GRIP_Z = range(6)
FIELDS_SHOWN = 6
# What is known of a strip: its limits, its smallest gap one step ago, its touch, its failure.
HEIGHT, OPENING, TOUCH_GAP, LENGTH = range(4)
GAP, GAP_X, GAP_S = range(4, 7)
TIME, TOUCH_X, TOUCH_S = range(7, 10)
FAILED = 10
KNOWN_SIZE = 11


class Batch(NamedTuple):
    """Memory of n strips: solver arrays in blocks of lanes, and values of each strip.

    `nature`, the coefficients, and `state` (blocks, rows, fields[, LANE_COUNT]); `work` and `band`,
    which blocks share; `strips` and `alive`: which strip each lane holds and whether it is still
    simulated; of each strip `known` (n, KNOWN_SIZE), `arc` (n, nodes) and `held` (n, 3), its last
    grip pose; `last` and `terms` as in Block.
    """

    nature: Any
    state: Any
    work: Any
    band: Any
    strips: Any
    alive: Any
    known: Any
    arc: Any
    held: Any
    last: int
    terms: Any


@kernel
def copy_midline(state: Any, lane: int, x: Any, z: Any) -> None:
    """Copy the midline of the strip in lane `lane` of a block into `x` and `z` (nodes,) [m]."""
    for j in range(len(x)):
        x[j] = pick(state, j + 1, at.X, lane)
        z[j] = pick(state, j + 1, at.Z, lane)


@kernel
def write_touch(known: Any, gap: Any, time: float, h: float) -> None:
    """Write the layer touch, where the `gap` (height, x, s) fell to its limit, into `known`."""
    height, x, s = gap
    share = 1.0
    if math.isfinite(known[GAP]) and known[GAP] > known[TOUCH_GAP]:
        share = (known[GAP] - known[TOUCH_GAP]) / (known[GAP] - height)
        x = known[GAP_X] + share * (x - known[GAP_X])
        s = known[GAP_S] + share * (s - known[GAP_S])
    known[TIME], known[TOUCH_X], known[TOUCH_S] = time - h + share * h, x, s


@kernel
def measure(x: Any, z: Any, known: Any, shown: Any) -> Any:
    """Write the observables of one shape into `shown`; returns height and node of its layer gap."""
    tip = rightmost(x)
    shown[CONTACT_X] = desk_contact(x, z, tip, known[HEIGHT])
    shown[TIP_X], shown[TIP_Z] = fold_tip(x, z, tip)
    return layer_gap(x, z, tip, known[OPENING])


@kernel
def observe(batch: Any, b: int, shown: Any, k: int, time: float, h: float) -> None:
    """Measure the active lanes of block `b` after step `k`, and end strips whose layers touched."""
    nodes = batch.arc.shape[1]
    x, z = np.empty(nodes), np.empty(nodes)
    for lane in range(batch.strips.shape[1]):
        if pick(batch.alive[b], 0, 0, lane) > 0.0:
            i = batch.strips[b, lane]
            copy_midline(batch.state[b], lane, x, z)
            shown[k, i, HOLDING] = -pick(batch.state[b], 1, at.TENSION, lane)
            for axis in range(2):
                shown[k, i, GRIP_X + axis] = pick(
                    batch.state[b], nodes + 1, at.GRIP_FORCE_X + axis, lane
                )
            known = batch.known[i]
            height, index = measure(x, z, known, shown[k, i])
            gap = height, along(x, index), along(batch.arc[i], index)
            if height <= known[TOUCH_GAP]:
                write_touch(known, gap, time, h)
                retire(batch, b, lane, shown, k)
            known[GAP], known[GAP_X], known[GAP_S] = gap


@kernel
def retire(batch: Any, b: int, lane: int, shown: Any, k: int) -> None:
    """End the strip in one lane after step `k`: its observables stay constant from then on."""
    put(batch.alive[b], 0, 0, lane, 0.0)
    i = batch.strips[b, lane]
    for later in range(k + 1, len(shown)):
        for field in range(FIELDS_SHOWN):
            shown[later, i, field] = shown[k, i, field]


@kernel
def end_failed(batch: Any, b: int, unsolved: Any, shown: Any, k: int, time: float) -> None:
    """End the strips of block `b` that failed to converge in step `k`."""
    for lane in range(batch.strips.shape[1]):
        if lane_of(unsolved, lane) > 0.0:
            batch.known[batch.strips[b, lane], FAILED] = time
            retire(batch, b, lane, shown, k)


@kernel
def record(batch: Any, b: int, shapes: Any) -> None:
    """Copy the midlines of the active lanes of block `b` into `shapes` (n, nodes, 2) [m]."""
    for lane in range(batch.strips.shape[1]):
        if pick(batch.alive[b], 0, 0, lane) > 0.0:
            shape = shapes[batch.strips[b, lane]]
            copy_midline(batch.state[b], lane, shape[:, 0], shape[:, 1])


@kernel
def alive_in(batch: Any, b: int) -> int:
    """Number of lanes of block `b` that are still simulated."""
    count = 0
    for lane in range(batch.strips.shape[1]):
        count += pick(batch.alive[b], 0, 0, lane) > 0.0
    return count


@kernel
def alive_lanes(batch: Any) -> int:
    """Number of lanes of all blocks that are still simulated."""
    count = 0
    for b in range(len(batch.nature)):
        count += alive_in(batch, b)
    return count


@kernel
def store_poses(batch: Any, b: int, poses: Any) -> None:
    """Store `poses` (n, 3) as the last grip poses of the strips in block `b`."""
    for i in batch.strips[b]:
        if i < len(batch.held):
            for c in range(3):
                batch.held[i, c] = poses[i, c]


@entry
def follow(
    batch: Any, poses: Any, shown: Any, shapes: Any, every: int, start: float, pace: Any
) -> int:
    """Step the batch along poses (k, n, 3), one step each, from time `start` [s].

    Writes into shown (k, n, FIELDS_SHOWN), and shapes (k // every, n, nodes, 2) unless they are
    empty; returns the number of strips that ended.
    """
    before = alive_lanes(batch)
    for b in range(len(batch.nature)):
        nature, state = batch.nature[b], batch.state[b]
        block = Block(nature, state, batch.work, batch.band, batch.last, batch.terms)
        now = pace
        for k in range(len(poses)):
            if alive_in(batch, b) == 0:
                break
            grips = Grips(batch.strips[b], batch.alive[b], batch.held, poses[k])
            time = start + (k + 1) * pace.h
            unsolved = step(block, grips, now)
            if anywhere(unsolved):
                end_failed(batch, b, unsolved, shown, k, time)
            if len(shapes) > 0 and (k + 1) % every == 0:
                record(batch, b, shapes[(k + 1) // every - 1])
            observe(batch, b, shown, k, time, pace.h)
            store_poses(batch, b, poses[k])
            now = Pace(pace.h, pace.next_omega, pace.next_omega, pace.tolerance)
    return before - alive_lanes(batch)
