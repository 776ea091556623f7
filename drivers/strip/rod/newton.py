"""Newton's method for one implicit step of a rod: assembly, elimination, correction.

The tangent matrix is symmetric with half bandwidth 5 and is factorised in place into L
D L^T. Row r of `band` (rows, 7[, LANE_COUNT]) holds 1/D(r) in column 0, L(r, r - j) in
column j = 1..5 and the right-hand side, later the solution, in column 6. Rows before
the first unknown are zero.
"""

from typing import Any

from drivers.base.jit import kernel
from drivers.strip.rod import layout as at
from drivers.strip.rod.bending import internal_forces
from drivers.strip.rod.lanes import (
    any_lane,
    below,
    fma,
    load,
    pair,
    select,
    splat,
    store,
    update,
)
from drivers.strip.rod.terms import air_drag, settling_turn, update_stuck

ITERATIONS = 10
TURN_TOLERANCE = 1e-4  # rad, root mean square of the last turns of the segments
# rad^2, square of a turn in one correction, more than a step of a fold needs
LARGEST_TURN = 1.0
SINK = 2e-5  # m over which the desk takes up the weight
PIVOT_COLUMN, SIDE_COLUMN = 0, 6


@kernel
def desk_reaction(block: Any, r: int) -> Any:
    """Upward force [N] of the desk on the node at row `r`, and its stiffness [N/m].

    A one-sided spring, quadratic, then linear; at z = 0 exactly the weight, which so
    lies at rest.
    """
    weight = load(block.nature, r, at.DESK)
    depth = 1.5 - load(block.state, r, at.Z) * (1.0 / SINK)
    touching = select(depth, depth, 0.0)
    full = below(1.0, touching)
    force = select(full, touching - 0.5, 0.5 * touching * touching)
    slope = select(full, 1.0, touching)
    return weight * force, weight * slope * (1.0 / SINK)


@kernel
def residual(block: Any, r: int, inertia: Any, reaction: Any) -> Any:
    """Residual force x, z [N] on the node at row `r`: inertia and internal forces less
    weight and desk reaction.
    """
    work = block.work
    x, z = pair(block.state, r, at.X)
    hat_x, hat_z = pair(work, r, at.HAT_X)
    before_x, before_z = pair(work, r - 1, at.PULL_X)
    after_x, after_z = pair(work, r, at.PULL_X)
    load_x, load_z = pair(block.nature, r, at.LOAD_X)
    x = inertia * (x - hat_x) + (before_x - after_x) - load_x
    z = inertia * (z - hat_z) + (before_z - after_z) - load_z
    return x, z - reaction


@kernel
def _add_outer(a: Any, b: Any, matrix: Any) -> Any:
    """Sum of a 2 x 2 `matrix`, given as xx, xz, zx, zz, and the outer product a b' of
    two vectors x, z.
    """
    xx, xz, zx, zz = matrix
    return (
        fma(a[0], b[0], xx),
        fma(a[0], b[1], xz),
        fma(a[1], b[0], zx),
        fma(a[1], b[1], zz),
    )


@kernel
def _scaled(factor: Any, vector: Any) -> Any:
    """Product of a scalar `factor` and a `vector` x, z."""
    return factor * vector[0], factor * vector[1]


@kernel
def _tangent_blocks(work: Any, r: int, inertia: Any) -> Any:
    """Three 2 x 2 blocks xx, xz, zx, zz of the tangent matrix: node row `r` with
    itself, with r - 1 and with r - 2.

    A = sum_j k_j t_j t_j' + S + inertia over the angles j = r - 1, r, r + 1, with k_j =
    d(moment)/d(angle), t_j the angle's turn per motion of the nodes, S the stiffness of
    the two segments. With n(r) the turn of segment r, its normal over its length, angle
    r turns with n(r-1) per motion of node r - 1, -(n(r-1) + n(r)) per that of node r,
    and n(r) per that of node r + 1.
    """
    far = pair(work, r - 2, at.TURN_X)
    left = pair(work, r - 1, at.TURN_X)
    right = pair(work, r, at.TURN_X)

    here = left[0] + right[0], left[1] + right[1]
    before = far[0] + left[0], far[1] + left[1]
    left_moment = _scaled(load(work, r - 1, at.TANGENT), left)
    here_moment = _scaled(load(work, r, at.TANGENT), here)
    right_moment = _scaled(load(work, r + 1, at.TANGENT), right)
    left_xx, left_xz = pair(work, r - 1, at.S_XX)
    left_zz = load(work, r - 1, at.S_ZZ)
    right_xx, right_xz = pair(work, r, at.S_XX)
    right_zz = load(work, r, at.S_ZZ)

    bending = _add_outer(left_moment, left, (inertia, left_xz, left_xz, inertia))
    bending = _add_outer(here_moment, here, bending)
    xx, xz, _, zz = _add_outer(right_moment, right, bending)
    xz = xz + right_xz
    own = xx + (left_xx + right_xx), xz, xz, zz + (left_zz + right_zz)

    beside = _add_outer(left_moment, before, (left_xx, left_xz, left_xz, left_zz))
    xx, xz, zx, zz = _add_outer(here_moment, left, beside)
    two_away = (*_scaled(left_moment[0], far), *_scaled(left_moment[1], far))
    return own, (-xx, -xz, -zx, -zz), two_away


@kernel
def assemble(block: Any, r: int, rate: Any) -> None:
    """Assemble the x and z equations of the node at row `r` in the tangent matrix, and
    eliminate them.
    """
    inertia = load(block.nature, r, at.MASS) * rate * rate
    reaction, support = desk_reaction(block, r)
    force_x, force_z = residual(block, r, inertia, reaction)
    own, near, far = _tangent_blocks(block.work, r, inertia)
    xx, xz, _, zz = own
    if block.terms is not None:
        (drag_x, drag_z), (drag_xx, drag_xz, drag_zz) = air_drag(block, r, rate)
        force_x = force_x + drag_x
        force_z = force_z + drag_z
        xx = xx + drag_xx
        xz = xz + drag_xz
        zz = zz + drag_zz

    row_x = far[0], far[1], near[0], near[1]
    row_z = far[2], far[3], near[2], near[3], xz
    _eliminate(block.band, 2 * r, row_x, xx, force_x)
    _eliminate_fifth(block.band, 2 * r + 1, row_z, zz + support, force_z)


@kernel
def _eliminate(band: Any, r: int, row: Any, diagonal: Any, side: Any) -> None:
    """Factorise row `r` of the banded tangent matrix, and substitute its right-hand
    `side` forward.

    The entries `row` are A(r, r - j), j = 4..1.

    v_j = A(r, r-j) - sum_{k>j} v_k L(r-j, r-k); L(r, r-j) = v_j / D(r-j);
    D(r) = A(r, r) - sum_j v_j L(r, r-j).
    """
    v4, a3, a2, a1 = row
    v3 = a3 - v4 * load(band, r - 3, 1)
    v2 = fma(-v3, load(band, r - 2, 1), fma(-v4, load(band, r - 2, 2), a2))
    v1 = fma(-v4, load(band, r - 1, 3), fma(-v3, load(band, r - 1, 2), a1))
    v1 = fma(-v2, load(band, r - 1, 1), v1)

    l4 = v4 * load(band, r - 4, PIVOT_COLUMN)
    l3 = v3 * load(band, r - 3, PIVOT_COLUMN)
    l2 = v2 * load(band, r - 2, PIVOT_COLUMN)
    l1 = v1 * load(band, r - 1, PIVOT_COLUMN)
    pivot = fma(-v1, l1, fma(-v2, l2, fma(-v3, l3, fma(-v4, l4, diagonal))))

    side = fma(-l3, load(band, r - 3, SIDE_COLUMN), side)
    side = fma(-l4, load(band, r - 4, SIDE_COLUMN), side)
    side = fma(-l2, load(band, r - 2, SIDE_COLUMN), side)
    side = fma(-l1, load(band, r - 1, SIDE_COLUMN), side)

    store(band, r, 1, l1)
    store(band, r, 2, l2)
    store(band, r, 3, l3)
    store(band, r, 4, l4)
    store(band, r, SIDE_COLUMN, side)
    store(band, r, PIVOT_COLUMN, 1.0 / pivot)


@kernel
def _eliminate_fifth(band: Any, r: int, row: Any, diagonal: Any, side: Any) -> None:
    """Factorise row `r` of the tangent matrix as `_eliminate` does, with five entries
    A(r, r - j), j = 5..1.
    """
    a5, a4, a3, a2, a1 = row
    l5 = a5 * load(band, r - 5, PIVOT_COLUMN)
    store(band, r, 5, l5)
    row_of_four = (
        fma(-a5, load(band, r - 4, 1), a4),
        fma(-a5, load(band, r - 3, 2), a3),
        fma(-a5, load(band, r - 2, 3), a2),
        fma(-a5, load(band, r - 1, 4), a1),
    )
    side = fma(-l5, load(band, r - 5, SIDE_COLUMN), side)
    _eliminate(band, r, row_of_four, fma(-a5, l5, diagonal), side)


@kernel
def _substitute(band: Any, first: int, last: int) -> None:
    """Solve rows `first` to `last` of the factorised `band` backwards; the solution is
    in its column SIDE_COLUMN.

    x_r = y_r / D(r) - sum_j L(r+j, r) x_{r+j}. Rows last + 1 .. last + 5 must exist;
    their columns 1..5 and SIDE_COLUMN are overwritten by zeros.
    """
    zero = splat(band, 0.0)
    for r in range(last + 1, last + 6):
        for column in range(1, SIDE_COLUMN + 1):
            store(band, r, column, zero)
    for r in range(last, first - 1, -1):
        x = load(band, r, SIDE_COLUMN) * load(band, r, PIVOT_COLUMN)
        for j in range(5, 0, -1):
            x = fma(-load(band, r + j, j), load(band, r + j, SIDE_COLUMN), x)
        store(band, r, SIDE_COLUMN, x)


@kernel
def _apply_correction(block: Any, gate: Any) -> Any:
    """Apply the solved Newton step to the rods' nodes and tensions, in the lanes where
    `gate` is above 0.

    Returns the mean and the largest squared turn [rad^2] of each lane's segments. T =
    EA (l / l0 - 1 + t de / l0) is the tension of the linearised segment, free of the
    stretch that a turn of a straight piece feigns.
    """
    state = block.state
    work = block.work
    band = block.band
    turned = splat(state, 0.0)
    wildest = splat(state, 0.0)
    dx_before = splat(state, 0.0)
    dz_before = splat(state, 0.0)
    for r in range(at.FIRST_FREE_NODE, state.shape[0] - 1):
        dx = load(band, 2 * r, SIDE_COLUMN)
        dz = load(band, 2 * r + 1, SIDE_COLUMN)
        x, z = pair(state, r, at.X)
        update(state, r, at.X, gate, x - dx)
        update(state, r, at.Z, gate, z - dz)

        turn_x, turn_z = pair(work, r - 1, at.TURN_X)
        ex = dx - dx_before
        ez = dz - dz_before
        turn = fma(turn_x, ex, turn_z * ez)
        square = turn * turn
        turned = fma(load(block.nature, r - 1, at.SHARE), square, turned)
        wildest = select(square - wildest, square, wildest)

        along = fma(turn_z, ex, -(turn_x * ez))
        tension = fma(-load(work, r - 1, at.GROWTH), along, load(work, r - 1, at.TAUT))
        if block.terms is not None:
            turned = turned + settling_turn(block, r - 1, along)
            update_stuck(block, r - 1, along)
        update(state, r - 1, at.TENSION, gate, tension)
        dx_before, dz_before = dx, dz
    return turned, wildest


@kernel
def solve(block: Any, rate: Any, alive: Any) -> Any:
    """Iterate Newton's method for one time step of the rods in the lanes `alive`;
    returns the lanes that failed to converge.

    It ends when segments turn by less than TURN_TOLERANCE, root mean square: by ten
    times that, a motion jumps as its model varies, and no finite difference of it is a
    slope. A lane with a segment that turns by more than LARGEST_TURN in one correction
    failed: Newton's method could then converge to a kinked equilibrium that does not
    continue the motion.
    """
    unsolved = alive
    failed = 0.0 * alive
    for _ in range(ITERATIONS):
        internal_forces(block, rate)
        for r in range(at.FIRST_FREE_NODE, block.last + 1):
            assemble(block, r, rate)

        _substitute(block.band, 2 * at.FIRST_FREE_NODE, 2 * block.last + 1)
        turned, wildest = _apply_correction(block, unsolved)
        sane = below(turned, LARGEST_TURN) * below(wildest, LARGEST_TURN)
        failed = select(unsolved * (1.0 - sane), unsolved, failed)
        unsolved = (
            unsolved * sane * (1.0 - below(turned, TURN_TOLERANCE * TURN_TOLERANCE))
        )
        if not any_lane(unsolved):
            break
    return select(unsolved, unsolved, failed)
