"""Implicit time step of a block of strips, in substeps where a lane fails to converge.

Second-order backward difference (BDF2) with variable step, or backward Euler. With
omega the step over the last one, a rate is gamma (value - base), gamma = (1 + 2 omega)
/ ((1 + omega) h), base = ((1 + omega)^2 v - omega^2 v1) / (1 + 2 omega); omega = 0 is
backward Euler and starts a motion from rest.

Only abrupt events need substeps: a gripper that starts at full speed beside a straight
strip makes it buckle within one step.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from drivers.base.jit import kernel
from drivers.strip.rod import layout as at
from drivers.strip.rod.bending import direction, dry_friction, strain
from drivers.strip.rod.lanes import (
    any_lane,
    below,
    fma,
    load,
    load_lane,
    pair,
    select,
    splat,
    store,
    store_lane,
    update,
)
from drivers.strip.rod.newton import desk_reaction, solve
from drivers.strip.rod.terms import (
    HUGE,
    air_drag,
    predict_terms,
    slip_direction,
    slip_limit,
    store_history,
    velocity,
)

SUBSTEPS = (16, 256)  # of a failed step, in the first and in the second attempt


class Grips(NamedTuple):
    """Gripper poses of all n strips before and after a step, and which strips the lanes
    of one block hold.

    `strips` are those that the lanes hold, LANE_COUNT or one, `alive` whether each is
    still simulated; `before` (n, 3) are the poses before the step, `poses` (n, 3) those
    after it.
    """

    strips: Any
    alive: Any
    before: Any
    poses: Any


class Pace(NamedTuple):
    """Timing of a series of steps: `start` [s] before the first step, step size `h`
    [s], and BDF2 step ratios.

    `omega` is the ratio of the step to the last one, `next_omega` that of equal steps
    after it: 1, or 0 for backward Euler.
    """

    start: float
    h: float
    omega: float
    next_omega: float


@kernel
def weights(omega: float) -> Any:
    """BDF2 weights of the last and the second last value, where `omega` is the step
    size over that of the last step.
    """
    return (1.0 + omega) ** 2 / (1.0 + 2.0 * omega), -(omega**2) / (1.0 + 2.0 * omega)


@kernel
def _predict_motion(block: Any, h: float, omega: float, alive: Any) -> None:
    """Extrapolate the free nodes over a step of `h` [s], and store the values that BDF2
    combines: history and bases.

    The base of a node, and where the base of its velocity (see the module) would take
    it, go into the work array.
    """
    state = block.state
    work = block.work
    period = h * (1.0 + omega) / (1.0 + 2.0 * omega)
    newest, older = weights(omega)
    ahead = h * (1.0 + 0.5 * omega)
    behind = -0.5 * omega * h

    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        for axis in range(2):
            x = load(state, r, at.X + axis)
            v = load(state, r, at.VX + axis)
            x1 = load(state, r, at.X1 + axis)
            v1 = load(state, r, at.VX1 + axis)
            base = fma(newest, x, older * x1)
            store(work, r, at.BASE_X + axis, base)
            store(
                work, r, at.HAT_X + axis, fma(fma(newest, v, older * v1), period, base)
            )
            update(state, r, at.X1 + axis, alive, x)
            update(state, r, at.VX1 + axis, alive, v)
            guess = x + fma(ahead, v, behind * v1)
            update(state, r, at.X + axis, alive, guess)


@kernel
def _predict_strain(block: Any, omega: float) -> None:
    """Write each node's BDF2 base, the weighted sum of its last two bending strains,
    into the block's `work`.
    """
    state = block.state
    newest, older = weights(omega)
    for r in range(1, state.shape[0] - 1):
        eps = load(state, r, at.EPS)
        eps1 = load(state, r, at.EPS1)
        store(block.work, r, at.BASE_EPS, fma(newest, eps, older * eps1))


@kernel
def _store_velocity(block: Any, rate: float, alive: Any) -> None:
    """Store the free nodes' velocities, `rate` [1/s] times the distance from their BDF2
    base, in the lanes where `alive` > 0.
    """
    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        vx, vz = velocity(block, r, rate)
        update(block.state, r, at.VX, alive, vx)
        update(block.state, r, at.VZ, alive, vz)


@kernel
def _store_strain(block: Any, rate: float, alive: Any) -> None:
    """Store the nodes' bending strains, friction and history after a step of BDF2
    `rate` [1/s], in the lanes where `alive` > 0.
    """
    state = block.state
    last_tangent = direction(state, 0)
    for r in range(1, state.shape[0] - 1):
        tangent = direction(state, r)
        new, _ = strain(last_tangent, tangent)
        dry, _ = dry_friction(block, r, new)
        update(state, r, at.FRICTION, alive, dry)
        if block.terms is not None:
            store_history(block, r, new, rate, alive)

        # friction and history read the last one
        update(state, r, at.EPS1, alive, load(state, r, at.EPS))
        update(state, r, at.EPS, alive, new)
        last_tangent = tangent


@kernel
def grip_force(block: Any, h: float, rate: Any, alive: Any) -> None:
    """Store the strip's force [N] on its gripper, from the momentum balance of the free
    nodes.

    The shear of the last, short segments would contain what error Newton's method
    leaves.
    """
    state = block.state
    nature = block.nature
    work = block.work
    end = state.shape[0] - 2
    ghost = state.shape[0] - 1

    # the pull of the first segment, which holds the fixed edge
    ux, uz, _, _ = direction(state, 1)
    turn_x, turn_z = pair(work, 1, at.TURN_X)
    pull_x, pull_z = pair(work, 1, at.PULL_X)
    tension = load(state, 1, at.TENSION)
    shear = fma(turn_x, pull_x, turn_z * pull_z) / fma(turn_x, turn_x, turn_z * turn_z)
    x = -fma(shear, turn_x, tension * ux)
    z = -fma(shear, turn_z, tension * uz)

    # weight and desk, then what accelerates the nodes and brakes them in air
    for r in range(at.FIRST_FREE_NODE, end + 1):
        weight_x, weight_z = pair(nature, r, at.LOAD_X)
        reaction, _ = desk_reaction(block, r)
        x = x + weight_x
        z = z + (weight_z + reaction)
    for r in range(at.FIRST_FREE_NODE, end):
        push = load(nature, r, at.MASS) * (1.0 / h)
        vx, vz = pair(state, r, at.VX)
        vx1, vz1 = pair(state, r, at.VX1)
        x = x - push * (vx - vx1)
        z = z - push * (vz - vz1)
        if block.terms is not None:
            (drag_x, drag_z), _ = air_drag(block, r, rate)
            x = x - drag_x
            z = z - drag_z

    update(state, ghost, at.GRIP_FORCE_X, alive, x)
    update(state, ghost, at.GRIP_FORCE_Z, alive, z)


@kernel
def _slip_length(block: Any, r: int) -> Any:
    """Distance [m] by which the strip's end at segment `r` slid in the step just
    solved.
    """
    state = block.state
    stretch = load(block.nature, r, at.STRETCH)
    span = load(block.nature, r, at.SPAN)
    _, _, _, length = direction(state, r)
    taut = stretch * (length - span - load(state, r, at.SLID))
    sign = slip_direction(block, r, taut)
    level = select(sign, slip_limit(block, r), -load(state, r, at.HELD))
    return select(sign * sign, (taut - level) / stretch, 0.0)


@kernel
def _slide_in_grip(block: Any, alive: Any) -> None:
    """Lengthen the segment at the gripper by what slid out of it in this step.

    That piece is straight and massless, valid for a few per cent of the strip. Arc
    lengths end at the edge that was grasped, so the upper layer does not grow by it.
    """
    state = block.state
    r = state.shape[0] - 3
    slid = load(state, r, at.SLID) + _slip_length(block, r)
    update(state, r, at.SLID, alive, slid)


@kernel
def _slide_edge(block: Any, alive: Any) -> None:
    """Move a loose fixed edge by the distance it slid, and update the friction that
    holds it.

    All friction of the lying part acts at its edge: that part is straight and hardly
    stretches, so it slides as a whole when the pull exceeds friction times the normal
    force of the desk.
    """
    state = block.state
    away = _slip_length(block, 1)
    for r in range(2):
        update(state, r, at.X, alive, load(state, r, at.X) + away)

    borne = splat(state, 0.0)
    for r in range(1, block.last + 1):
        reaction, _ = desk_reaction(block, r)
        borne = borne + reaction

    cling = load(block.nature, 1, at.CLING)
    friction = select(below(HUGE, cling), cling, cling * borne)
    update(state, 1, at.HELD, alive, friction)


@kernel
def _implicit_step(block: Any, h: float, omega: float, alive: Any) -> Any:
    """Advance the lanes where `alive` > 0 by one implicit step of `h` [s]; returns the
    lanes that failed to converge.
    """
    rate = (1.0 + 2.0 * omega) / ((1.0 + omega) * h)
    _predict_motion(block, h, omega, alive)
    _predict_strain(block, omega)
    if block.terms is not None:
        predict_terms(block, rate, weights(omega))

    unsolved = solve(block, rate, alive)
    solved = alive - unsolved
    _store_velocity(block, rate, solved)
    _store_strain(block, rate, solved)
    if block.terms is not None:
        _slide_in_grip(block, solved)
        _slide_edge(block, solved)
    if block.last < block.state.shape[0] - 2:
        grip_force(block, h, rate, solved)

    return unsolved


@kernel
def _place_grip(block: Any, lane: int, pose: Any) -> None:
    """Move the grasped edge of the strip in lane `lane`, with its ghost node, to the
    gripper `pose` (3,) [m, m, rad].
    """
    state = block.state
    row = state.shape[0] - 2
    span = load_lane(block.nature, row, at.SPAN, lane)
    store_lane(state, row, at.X, lane, pose[0])
    store_lane(state, row, at.Z, lane, pose[1])
    store_lane(state, row + 1, at.X, lane, pose[0] + span * math.cos(pose[2]))
    store_lane(state, row + 1, at.Z, lane, pose[1] + span * math.sin(pose[2]))


@kernel
def _place_grips(block: Any, grips: Any, fraction: float) -> None:
    """Move the grasped edges of the active lanes to the gripper poses at `fraction` of
    the step.
    """
    if block.last == block.state.shape[0] - 2:
        return
    pose = np.empty(3)
    for lane in range(len(grips.strips)):
        if load_lane(grips.alive, 0, 0, lane) > 0.0:
            i = grips.strips[lane]
            for c in range(3):
                goal = grips.poses[i, c]
                pose[c] = goal - (1.0 - fraction) * (goal - grips.before[i, c])
            _place_grip(block, lane, pose)


@kernel
def _rewind(block: Any, gate: Any) -> None:
    """Undo a failed step: restore the nodes' positions and velocities and clear
    tensions, in the lanes where `gate` > 0.
    """
    state = block.state
    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        for field in range(at.EPS):
            update(state, r, at.X + field, gate, load(state, r, at.X1 + field))
    for r in range(state.shape[0]):
        update(state, r, at.TENSION, gate, 0.0)


@kernel
def _copy_fields(source: Any, fields: Any, target: Any, to: int, gate: Any) -> None:
    """Copy fields first to end of `source` to those of `target` from field `to` on, in
    the lanes where `gate` > 0.
    """
    first, end = fields
    for r in range(target.shape[0]):
        for c in range(end - first):
            update(target, r, to + c, gate, load(source, r, first + c))


@kernel
def _step_in_parts(block: Any, grips: Any, pace: Any, gate: Any, parts: int) -> Any:
    """Step the lanes where `gate` > 0 in `parts` equal substeps, the first by backward
    Euler; returns the lanes that failed.
    """
    stepping = gate
    for part in range(parts):
        _place_grips(block, grips, (part + 1) / parts)
        omega = pace.next_omega if part > 0 else 0.0
        stepping = stepping - _implicit_step(block, pace.h / parts, omega, stepping)
        if not any_lane(stepping):
            break
    return gate - stepping


@kernel
def step(block: Any, grips: Any, pace: Any) -> Any:
    """Step a block of strips to the next poses of their grippers; returns the lanes
    that failed to converge.

    A lane that moved in substeps continues with the history of one full step; one that
    failed is left unchanged.
    """
    state = block.state
    _place_grips(block, grips, 1.0)
    gate = _implicit_step(block, pace.h, pace.omega, load(grips.alive, 0, 0))
    if not any_lane(gate):
        return gate

    _rewind(block, gate)
    start = state.copy()
    for parts in SUBSTEPS:
        failed = _step_in_parts(block, grips, pace, gate, parts)
        _copy_fields(start, (0, start.shape[1]), state, 0, failed)
        moved = gate - failed  # their history is the state before the whole step
        _copy_fields(start, (at.X, at.EPS), state, at.X1, moved)
        _copy_fields(start, (at.EPS, at.FRICTION), state, at.EPS1, moved)
        if block.terms is not None:
            _copy_fields(start, (at.MAXWELL, at.MAXWELL1), state, at.MAXWELL1, moved)

        gate = failed
        if not any_lane(gate):
            break

    _place_grips(block, grips, 1.0)
    return gate
