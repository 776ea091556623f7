"""Optional force terms of the rod: history-dependent moments, air drag, sliding ends.

Only batches with a strip that needs them run this code; a null coefficient adds zeros.
"""

from typing import Any

from drivers.base.jit import kernel
from drivers.strip.rod import layout as at
from drivers.strip.rod.lanes import (
    below,
    fma,
    load,
    pair,
    select,
    sqrt,
    store,
    store_pair,
    update,
)

HUGE = 1e300  # coefficients beyond are null at infinity
CORRECTION_TURN = 100.0  # rad/m: a correction by 1 um counts as one by 1e-4 rad
UNTRIED = 2.0  # sliding direction before the first iteration of a step
UNSETTLED = 0.1  # rad^2 as which a correction counts at most


@kernel
def _magnitude(a: Any) -> Any:
    """Absolute value of `a`, lane by lane."""
    return select(below(a, 0.0), -a, a)


@kernel
def _maxwell_strain(block: Any, r: int, change: Any, rate: Any) -> Any:
    """Strain q of the Maxwell element at node row `r`, which obeys dq/dt = deps/dt - q
    / time, and its derivative dq/deps.

    `change` is eps - base, so deps/dt = rate change and dq/dt = rate (q - base of q).
    """
    fraction = rate / (rate + load(block.nature, r, at.FADE))
    return fraction * (load(block.work, r, at.BASE_MAXWELL) + change), fraction


@kernel
def lagging_moment(block: Any, r: int, change: Any, rate: Any) -> Any:
    """Rate- and history-dependent bending moment [N m] at node row `r`, and its
    derivative by the strain.

    Q |deps/dt| deps/dt of quadratic damping, and K q of the rigidity that relaxes.
    """
    q, fraction = _maxwell_strain(block, r, change, rate)
    speed = rate * change
    resistance = load(block.nature, r, at.QUADRATIC) * _magnitude(speed)
    branch = load(block.nature, r, at.BRANCH)
    return fma(resistance, speed, branch * q), fma(
        2.0 * resistance, rate, branch * fraction
    )


@kernel
def _gradual_element(slip: Any, pace: Any, change: Any, before: Any) -> Any:
    """Moment [N m] of a friction element without yield point after a `change` of
    strain, and its derivative by the strain.

    dM/deps = pace (slip - s M) with s the sign of the change: Dahl's law of exponent 1.
    Of x = pace |change|, exp(-x) is taken as 1 / (1 + x + x^2 / 2 + x^3 / 6), which
    stays positive.
    """
    back = below(change, 0.0)
    limit = select(back, -slip, slip)
    x = pace * select(back, -change, change)
    slope = fma(x, fma(0.5, x, 1.0), 1.0)
    growth = fma(x * x, x * (1.0 / 6.0), slope)
    ahead = (limit - before) / growth  # the moment still to come
    return limit - ahead, pace * slope * select(back, -ahead, ahead) / growth


@kernel
def gradual_friction(block: Any, r: int, eps: Any) -> Any:
    """Moment [N m] at node row `r` of the friction element without a yield point at
    bending strain `eps`, and its derivative by the strain.
    """
    slip, pace = pair(block.nature, r, at.GRADUAL_SLIP)
    change = eps - load(block.state, r, at.EPS)
    return _gradual_element(slip, pace, change, load(block.state, r, at.GRADUAL))


@kernel
def slip_limit(block: Any, r: int) -> Any:
    """Tension [N] at which the strip begins to slide at segment `r`, next to the desk's
    fixed edge or the grip.
    """
    held = load(block.state, r, at.HELD)
    gripped = load(block.nature, r, at.GRIPPED)
    return select(held - gripped, gripped, held)


@kernel
def slip_direction(block: Any, r: int, taut: Any) -> Any:
    """Direction in which the strip's end at segment `r` slides if, stuck, the segment
    would bear the tension `taut` [N].

    1 where it is pulled, -1 where pushed, 0 where it sticks. In the grip a pushed strip
    buckles before it slides; a loose edge slides both ways.
    """
    pushed = below(taut, -load(block.state, r, at.HELD))
    return below(slip_limit(block, r), taut) - pushed


@kernel
def stick_slip(block: Any, r: int, taut: Any, stretch: Any, span: Any) -> Any:
    """Tension [N] and stiffness [N/m] of segment `r`, whose end sticks or slides.

    They are `taut` and `stretch` where it sticks, the constant slip limit and 0 where
    it slides. Whether it slides follows from the tension that the last linear solution
    gives it if it sticks: that of its positions is mostly the stretch that a turn of an
    almost inextensible piece feigns. An end that slid in one direction in the last
    iteration sticks in this one before it may slide in the other; otherwise Newton's
    method would alternate between the two. In the first iteration of a step all ends
    stick: tensions of extrapolated positions are meaningless.
    """
    work = block.work
    state = block.state
    taut = taut - stretch * load(state, r, at.SLID)
    sign = slip_direction(block, r, load(work, r, at.STUCK))
    before = load(state, r, at.SLIP_SIGN)
    sign = select(below(sign * before, -0.5), 0.0, sign)
    sign = select(below(UNTRIED - 0.5, before), 0.0, sign)
    store(state, r, at.SLIP_SIGN, sign)
    store_pair(work, r, at.STUCK, (taut, stretch * span))
    level = select(sign, slip_limit(block, r), -load(state, r, at.HELD))
    moves = sign * sign
    return select(moves, level, taut), select(moves, 0.0, stretch)


@kernel
def update_stuck(block: Any, r: int, along: Any) -> None:
    """Update the tension that segment `r` would bear if its end stuck, after a Newton
    correction `along` of its strain.
    """
    taut, growth = pair(block.work, r, at.STUCK)
    store(block.work, r, at.STUCK, fma(-growth, along, taut))


@kernel
def settling_turn(block: Any, r: int, along: Any) -> Any:
    """Squared turn [rad^2] that a strain correction `along` of segment `r` counts as in
    Newton's convergence test.

    A sliding strip moves without turning, so that turns alone would end Newton's method
    early.
    """
    turn = CORRECTION_TURN * along
    square = turn * turn
    square = select(square - UNSETTLED, UNSETTLED, square)
    return select(below(slip_limit(block, r), HUGE), square, 0.0)


@kernel
def velocity(block: Any, r: int, rate: Any) -> Any:
    """Velocity x, z [m/s] of the node at row `r`: `rate` [1/s] times its distance from
    the step's BDF2 base.
    """
    x, z = pair(block.state, r, at.X)
    base_x, base_z = pair(block.work, r, at.BASE_X)
    return rate * (x - base_x), rate * (z - base_z)


@kernel
def air_drag(block: Any, r: int, rate: Any) -> Any:
    """Air drag x, z [N] against the motion of the node at row `r`, and its derivative
    xx, xz, zz by the node's position.

    F = D v with D = 1/2 rho C_d width length (u + slow) (n n' + along t t') of the
    predicted motion: of second order in the step, and symmetric.
    """
    work = block.work
    xx, xz = pair(work, r, at.DRAG_XX)
    zz = load(work, r, at.DRAG_ZZ)
    vx, vz = velocity(block, r, rate)
    drag = fma(xx, vx, xz * vz), fma(xz, vx, zz * vz)
    return drag, (rate * xx, rate * xz, rate * zz)


@kernel
def _store_drag(block: Any, r: int, rate: Any) -> None:
    """Write the drag matrix of the node at row `r`, from its predicted motion, into the
    block's `work`.
    """
    nature = block.nature
    state = block.state
    work = block.work
    x, z = pair(state, r + 1, at.X)
    before_x, before_z = pair(state, r - 1, at.X)
    tx = x - before_x
    tz = z - before_z
    inverse = 1.0 / sqrt(fma(tx, tx, tz * tz))
    nx = -(tz * inverse)
    nz = tx * inverse

    vx, vz = velocity(block, r, rate)
    across = fma(nx, vx, nz * vz)
    along = fma(nz, vx, -(nx * vz))
    oblique = load(nature, r, at.OBLIQUE)
    speed = sqrt(fma(oblique * along, along, across * across))
    drag = load(nature, r, at.DRAG) * (speed + load(nature, r, at.SLOW))

    fraction = load(nature, r, at.ALONG)
    xx = fma(fraction * nz, nz, nx * nx)
    xz = fma(-(fraction * nx), nz, nx * nz)
    store_pair(work, r, at.DRAG_XX, (drag * xx, drag * xz))
    store(work, r, at.DRAG_ZZ, drag * fma(fraction * nx, nx, nz * nz))


@kernel
def store_history(block: Any, r: int, eps: Any, rate: Any, alive: Any) -> None:
    """Store the Maxwell strain and the gradual friction at node row `r` after a step to
    bending strain `eps`.
    """
    q, _ = _maxwell_strain(block, r, eps - load(block.work, r, at.BASE_EPS), rate)
    state = block.state
    update(state, r, at.MAXWELL1, alive, load(state, r, at.MAXWELL))
    update(state, r, at.MAXWELL, alive, q)
    dry, _ = gradual_friction(block, r, eps)
    update(state, r, at.GRADUAL, alive, dry)


@kernel
def predict_terms(block: Any, rate: Any, weights: Any) -> None:
    """Write into the block's `work` the drag matrices, and the BDF2 combinations of
    past Maxwell strains, for the coming step, and mark each end's slip as untried.
    """
    state = block.state
    newest, older = weights
    for r in range(1, state.shape[0] - 1):
        store(state, r, at.SLIP_SIGN, UNTRIED)
        q, q1 = pair(state, r, at.MAXWELL)
        store(block.work, r, at.BASE_MAXWELL, fma(newest, q, older * q1))
    for r in range(at.FIRST_FREE_NODE, block.last + 1):
        _store_drag(block, r, rate)
