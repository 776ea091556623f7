"""Newton's method for one implicit step of a rod: assemble, eliminate, update."""

from typing import Any

from drivers.strip.rod import layout as at
from drivers.strip.rod.band import SIDE, eliminate, eliminate_fifth, substitute
from drivers.strip.rod.bending import internal
from drivers.strip.rod.compiled import kernel
from drivers.strip.rod.lanes import anywhere, below, choose, fma, like, load, store

ITERATIONS = 10
TOLERANCE = 1e-4  # rad, root mean square of the last turns of the segments
WILD = 1.0  # rad^2, square of a turn in one correction that no step of ours needs
FIRST = 2  # row of the first free node


@kernel
def desk(nature: Any, state: Any, r: int) -> Any:
    """Upward force of the desk on row r and its fall per height: a one-sided spring.

    Quadratic, then linear; exactly the weight at z = 0, so that a strip at rest stays there.
    """
    weight = load(nature, r, at.DESK)
    depth = 1.5 - load(state, r, at.Z) * (1.0 / at.SINK)
    zero = 0.0 * depth
    touching = choose(depth, depth, zero)
    full = below(1.0, touching)
    force = choose(full, touching - 0.5, 0.5 * touching * touching)
    slope = choose(full, 1.0 + zero, touching)
    return weight * force, weight * slope * (1.0 / at.SINK)


@kernel
def residual(nature: Any, state: Any, work: Any, r: int, inertia: Any, reaction: Any) -> Any:
    """Unbalanced force on row r: inertia + internal forces - weight - desk."""
    x = inertia * (load(state, r, at.X) - load(work, r, at.HAT_X))
    z = inertia * (load(state, r, at.Z) - load(work, r, at.HAT_Z))
    x = x + (load(work, r - 1, at.PULL_X) - load(work, r, at.PULL_X)) - load(nature, r, at.LOAD_X)
    z = z + (load(work, r - 1, at.PULL_Z) - load(work, r, at.PULL_Z)) - load(nature, r, at.LOAD_Z)
    return x, z - reaction


@kernel
def assemble(nature: Any, state: Any, work: Any, band: Any, r: int, rate: Any) -> None:
    """Two rows of the tangent matrix, of node row r against r - 2, r - 1 and itself.

    The angle at row r turns with p(r-1) per x(r-1), -(p(r-1) + p(r)) per x(r), p(r) per x(r+1),
    p the normal over the length; K is dM/dangle; S a segment's own stiffness.
    """
    k0, k1, k2 = (
        load(work, r - 1, at.TANGENT),
        load(work, r, at.TANGENT),
        load(work, r + 1, at.TANGENT),
    )
    ox, oz = load(work, r - 2, at.TURN_X), load(work, r - 2, at.TURN_Z)
    px, pz = load(work, r - 1, at.TURN_X), load(work, r - 1, at.TURN_Z)
    qx, qz = load(work, r, at.TURN_X), load(work, r, at.TURN_Z)
    sx, sz = px + qx, pz + qz
    tx, tz = ox + px, oz + pz
    k0x, k0z, k1x, k1z = k0 * px, k0 * pz, k1 * sx, k1 * sz
    inertia = load(nature, r, at.MASS) * rate * rate
    reaction, support = desk(nature, state, r)
    gx, gz = residual(nature, state, work, r, inertia, reaction)
    bxx, bxz, bzz = (
        load(work, r - 1, at.S_XX),
        load(work, r - 1, at.S_XZ),
        load(work, r - 1, at.S_ZZ),
    )
    dxx = fma(k2 * qx, qx, fma(k1x, sx, fma(k0x, px, inertia))) + (bxx + load(work, r, at.S_XX))
    dxz = fma(k2 * qx, qz, fma(k1x, sz, fma(k0x, pz, bxz))) + load(work, r, at.S_XZ)
    dzz = fma(k2 * qz, qz, fma(k1z, sz, fma(k0z, pz, inertia))) + (bzz + load(work, r, at.S_ZZ))
    axx = -fma(k1x, px, fma(k0x, tx, bxx))
    axz = -fma(k1x, pz, fma(k0x, tz, bxz))
    azx = -fma(k1z, px, fma(k0z, tx, bxz))
    azz = -fma(k1z, pz, fma(k0z, tz, bzz))
    eliminate(band, 2 * r, k0x * ox, k0x * oz, axx, axz, dxx, gx)
    eliminate_fifth(band, 2 * r + 1, k0z * ox, k0z * oz, azx, azz, dxz, dzz + support, gz)


@kernel
def correct(nature: Any, state: Any, work: Any, band: Any, last: int, gate: Any) -> Any:
    """Move the free nodes by the solution where `gate`, and the tensions with them.

    T = EA (l / l0 - 1 + t de / l0): the tension of the linearised segment, free of the stretch
    that a turn of a straight piece feigns. Returns the mean and the largest of the squared turns
    of the segments [rad^2].
    """
    turned, wildest = like(state, 0.0), like(state, 0.0)
    x0, z0 = like(state, 0.0), like(state, 0.0)
    for r in range(FIRST, last + 2):
        dx, dz = load(band, 2 * r, SIDE), load(band, 2 * r + 1, SIDE)
        x, z = load(state, r, at.X), load(state, r, at.Z)
        store(state, r, at.X, choose(gate, x - dx, x))
        store(state, r, at.Z, choose(gate, z - dz, z))
        turn_x, turn_z = load(work, r - 1, at.TURN_X), load(work, r - 1, at.TURN_Z)
        turn = fma(turn_x, dx - x0, turn_z * (dz - z0))
        square = turn * turn
        turned = fma(load(nature, r - 1, at.SHARE), square, turned)
        wildest = choose(square - wildest, square, wildest)
        along = turn_z * (dx - x0) - turn_x * (dz - z0)
        tension = fma(-load(work, r - 1, at.GROWTH), along, load(work, r - 1, at.TAUT))
        store(state, r - 1, at.TENSION, choose(gate, tension, load(state, r - 1, at.TENSION)))
        x0, z0 = dx, dz
    return turned, wildest


@kernel
def solve(nature: Any, state: Any, work: Any, band: Any, rate: Any, alive: Any) -> Any:
    """Newton until segments turn less than TOLERANCE; the lanes that failed.

    A lane whose segments turn more than WILD in one correction has failed: from there Newton may
    find a shape with a kink, in equilibrium too, but not the one that follows in time.
    """
    last = state.shape[0] - 3
    unsolved = alive
    failed = 0.0 * alive
    for _ in range(ITERATIONS):
        internal(nature, state, work, rate)
        for r in range(FIRST, last + 1):
            assemble(nature, state, work, band, r, rate)
        substitute(band, 2 * FIRST, 2 * last + 1)
        turned, wildest = correct(nature, state, work, band, last, unsolved)
        sane = below(turned, WILD) * below(wildest, WILD)
        failed = choose(unsolved * (1.0 - sane), unsolved, failed)
        unsolved = unsolved * sane * (1.0 - below(turned, TOLERANCE * TOLERANCE))
        if not anywhere(unsolved):
            break
    return choose(unsolved, unsolved, failed)
