"""Stepping of blocks of strips along their grippers' paths, until their layers
touch.
"""

from typing import Any, NamedTuple

import numpy as np

from drivers.base.jit import entry, kernel
from drivers.strip.rod import layout as at
from drivers.strip.rod.lanes import lane_of, load_lane, store_lane
from drivers.strip.rod.layout import Block
from drivers.strip.rod.time_step import Grips, Pace, step
from drivers.strip.shape import at_index, features, layer_touch


class Output(NamedTuple):
    """Arrays that `step_along` fills for n strips over k steps, without bounds checks.

    `observed` (k, n, OBSERVABLE_COUNT), and `shapes` (k // every, n, nodes, 2) [m] at
    every `every`th step; empty for none.
    """

    observed: Any
    shapes: Any
    every: int


class Moment(NamedTuple):
    """Step number `k` of a simulation: its length `h` [s], and the `time` [s] at its
    end.
    """

    k: int
    time: float
    h: float


@kernel
def _copy_midline(state: Any, lane: int, x: Any, z: Any) -> None:
    """Copy the midline of the strip in lane `lane` of a block's `state` into the arrays
    `x` and `z` (nodes,) [m].
    """
    for j in range(len(x)):
        x[j] = load_lane(state, j + 1, at.X, lane)
        z[j] = load_lane(state, j + 1, at.Z, lane)


@kernel
def _finish_lanes(batch: Any, b: int, unsolved: Any, output: Any, moment: Any) -> None:
    """Write shapes and observables of the strips of block `b` at the end of a step, and
    end those in the lanes `unsolved`, which failed to converge, and those that have
    touched.
    """
    k = moment.k
    observed = output.observed
    nodes = batch.arc.shape[1]
    x = np.empty(nodes)
    z = np.empty(nodes)
    for lane in range(batch.strips.shape[1]):
        i = batch.strips[b, lane]
        if lane_of(unsolved, lane) > 0.0:
            batch.monitor[i, at.FAILURE_TIME] = moment.time
            retire(batch, b, lane, observed, k)
            continue
        if load_lane(batch.alive[b], 0, 0, lane) <= 0.0:
            continue

        _copy_midline(batch.state[b], lane, x, z)
        if len(output.shapes) > 0 and (k + 1) % output.every == 0:
            shape = output.shapes[(k + 1) // output.every - 1, i]
            shape[:, 0], shape[:, 1] = x, z

        height, index = _write_observables(batch, b, lane, (x, z), observed[k, i])
        gap = height, at_index(x, index), at_index(batch.arc[i], index)
        if _watch_gap(batch.monitor[i], gap, moment):
            retire(batch, b, lane, observed, k)


@kernel
def _write_observables(batch: Any, b: int, lane: int, midline: Any, row: Any) -> Any:
    """Write the observables (OBSERVABLE_COUNT,) of the strip in lane `lane` of block
    `b` into `row`, from its midline x, z (nodes,) [m].

    Returns the height [m] of its layer gap, and the gap's place as an index of nodes.
    """
    state = batch.state[b]
    monitor = batch.monitor[batch.strips[b, lane]]
    x, z = midline
    found = features(x, z, monitor[at.CONTACT_HEIGHT], monitor[at.OPENING])
    row[at.CONTACT_X], row[at.TIP_X], row[at.TIP_Z], height, index = found
    row[at.HOLDING] = -load_lane(state, 1, at.TENSION, lane)
    row[at.GRIP_X] = load_lane(state, len(x) + 1, at.GRIP_FORCE_X, lane)
    row[at.GRIP_Z] = load_lane(state, len(x) + 1, at.GRIP_FORCE_Z, lane)
    return height, index


@kernel
def _watch_gap(monitor: Any, gap: Any, moment: Any) -> Any:
    """Store the strip's layer gap, as height, x and arc length [m], in its `monitor`
    and, where it closed, the time and place of the touch; returns whether it did.
    """
    touched = gap[0] <= monitor[at.TOUCH_GAP]
    if touched:
        before = monitor[at.GAP_HEIGHT], monitor[at.GAP_X], monitor[at.GAP_S]
        fraction, touch_x, touch_s = layer_touch(before, gap, monitor[at.TOUCH_GAP])
        monitor[at.TOUCH_TIME] = moment.time - moment.h + fraction * moment.h
        monitor[at.TOUCH_X], monitor[at.TOUCH_S] = touch_x, touch_s
    monitor[at.GAP_HEIGHT], monitor[at.GAP_X], monitor[at.GAP_S] = gap
    return touched


@kernel
def retire(batch: Any, b: int, lane: int, observed: Any, k: int) -> None:
    """End the strip in lane `lane` of block `b` after step `k`; its rows in `observed`
    stay as they are at that step.
    """
    store_lane(batch.alive[b], 0, 0, lane, 0.0)
    i = batch.strips[b, lane]
    for later in range(k + 1, len(observed)):
        observed[later, i] = observed[k, i]


@kernel
def _living_lanes(batch: Any, first: int, end: int) -> int:
    """Number of strips in the blocks from `first` to before `end` that are still
    simulated.
    """
    count = 0
    for b in range(first, end):
        for lane in range(batch.strips.shape[1]):
            count += load_lane(batch.alive[b], 0, 0, lane) > 0.0
    return count


@kernel
def _store_poses(batch: Any, b: int, poses: Any) -> None:
    """Store `poses` (n, 3) [m, m, rad] as the last grip poses of the strips in block
    `b`.
    """
    for i in batch.strips[b]:
        if i < len(batch.grip):
            batch.grip[i] = poses[i]


@kernel
def _step_block(batch: Any, b: int, poses: Any, output: Any, pace: Any) -> None:
    """Step the strips of block `b` along gripper `poses` (steps, strips, 3) until none
    of them is simulated any more.
    """
    nature = batch.nature[b]
    state = batch.state[b]
    block = Block(nature, state, batch.work, batch.band, batch.last, batch.terms)
    step_pace = pace

    for k in range(len(poses)):
        if _living_lanes(batch, b, b + 1) == 0:
            break
        grips = Grips(batch.strips[b], batch.alive[b], batch.grip, poses[k])
        moment = Moment(k, pace.start + (k + 1) * pace.h, pace.h)
        _finish_lanes(batch, b, step(block, grips, step_pace), output, moment)
        _store_poses(batch, b, poses[k])
        step_pace = Pace(pace.start, pace.h, pace.next_omega, pace.next_omega)


@entry
def step_along(batch: Any, poses: Any, output: Any, pace: Any) -> int:
    """Step all strips of `batch` along gripper `poses` (steps, strips, 3) [m, m, rad],
    one step to each pose.

    Fills `output`; returns the number of strips that ended.
    """
    blocks = len(batch.nature)
    before = _living_lanes(batch, 0, blocks)
    for b in range(blocks):
        _step_block(batch, b, poses, output, pace)
    return before - _living_lanes(batch, 0, blocks)
