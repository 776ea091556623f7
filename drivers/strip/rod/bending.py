"""Bending at a node and stretch along a segment: forces and tangents of a planar rod."""

from typing import Any

from drivers.strip.rod import layout as at
from drivers.strip.rod.compiled import kernel
from drivers.strip.rod.lanes import below, choose, fma, load, sqrt, store


@kernel
def direction(state: Any, r: int) -> Any:
    """Unit tangent of segment r and one over its length [1/m]."""
    ex = load(state, r + 1, at.X) - load(state, r, at.X)
    ez = load(state, r + 1, at.Z) - load(state, r, at.Z)
    inverse = 1.0 / sqrt(fma(ex, ex, ez * ez))
    return ex * inverse, ez * inverse, inverse


@kernel
def strain(ax: Any, az: Any, bx: Any, bz: Any) -> Any:
    """Bending strain 4 tan(theta / 4) between unit tangents a, b; tan(theta / 4).

    Of the measures theta + O(theta^3) it is the one whose error nearly cancels that of the
    elastica's second difference, and needs no arc tangent.
    """
    cosine = fma(ax, bx, az * bz)
    sine = fma(ax, bz, -(az * bx))
    half = sine / (1.0 + cosine)
    quarter = half / (1.0 + sqrt(fma(half, half, 1.0)))
    return 4.0 * quarter, quarter


@kernel
def friction(nature: Any, state: Any, r: int, eps: Any) -> Any:
    """Moment of the elasto-plastic element at row r and its tangent (return mapping)."""
    stick, slip = load(nature, r, at.STICK), load(nature, r, at.SLIP)
    moment = fma(stick, eps - load(state, r, at.EPS), load(state, r, at.FRICTION))
    over, under = below(slip, moment), below(moment, -slip)
    moment = choose(over, slip, choose(under, -slip, moment))
    return moment, choose(over + under, 0.0 * stick, stick)


@kernel
def moment(nature: Any, state: Any, work: Any, r: int, eps: Any, rate: Any) -> Any:
    """Moment M(eps) [N m] at row r and dM/deps.

    M = K e (1 + cubic e^2) + D deps/dt + friction, e = eps - rest; deps/dt = rate (eps - base).
    """
    stiffness, cubic = load(nature, r, at.BEND), load(nature, r, at.CUBIC)
    damping = load(nature, r, at.DAMP) * rate
    e = eps - load(nature, r, at.REST)
    growth = cubic * e * e
    dry, dry_tangent = friction(nature, state, r, eps)
    total = fma(stiffness * e, 1.0 + growth, damping * (eps - load(work, r, at.BASE_EPS)))
    return total + dry, fma(stiffness, fma(3.0, growth, 1.0), damping) + dry_tangent


@kernel
def bend(nature: Any, state: Any, work: Any, r: int, a: Any, b: Any, rate: Any) -> Any:
    """Moment on the angle at row r between segments with tangents a and b.

    With q = tan(theta / 4): deps/dtheta = 1 + q^2, d2eps/dtheta2 = q (1 + q^2) / 2. Leaves the
    tangent d(moment)/dtheta in `work`.
    """
    eps, quarter = strain(a[0], a[1], b[0], b[1])
    value, slope = moment(nature, state, work, r, eps, rate)
    first = fma(quarter, quarter, 1.0)
    second = 0.5 * quarter * first
    store(work, r, at.TANGENT, fma(slope * first, first, value * second))
    return value * first


@kernel
def pull(nature: Any, state: Any, work: Any, r: int, u: Any, couple: Any) -> None:
    """Force of segment r on its first node, and its 2 x 2 stiffness, into `work`.

    f = T t + V n with tension T = EA (l / l0 - 1) and shear V = couple / l, couple the
    difference of the moments at its ends; df/de = EA/l0 t t' + T/l n n' + couple d2angle/de2.
    """
    ux, uz, inverse = u
    axial, span = load(nature, r, at.AXIAL), load(nature, r, at.SPAN)
    stretch = axial / span
    tension = stretch / inverse - axial
    string = load(state, r, at.TENSION)
    floor = load(nature, r, at.FLOOR)
    string = choose(string - floor, string, floor) * inverse
    turn_x, turn_z = -(uz * inverse), ux * inverse
    twist = couple * inverse * inverse
    store(work, r, at.TURN_X, turn_x)
    store(work, r, at.TURN_Z, turn_z)
    store(work, r, at.TAUT, tension)
    store(work, r, at.GROWTH, stretch / inverse)
    store(work, r, at.PULL_X, fma(tension, ux, couple * turn_x))
    store(work, r, at.PULL_Z, fma(tension, uz, couple * turn_z))
    along, across = ux * ux, ux * uz
    upward = uz * uz
    store(work, r, at.S_XX, fma(stretch, along, fma(string, upward, 2.0 * twist * across)))
    store(work, r, at.S_XZ, fma(stretch - string, across, twist * (upward - along)))
    store(work, r, at.S_ZZ, fma(stretch, upward, fma(string, along, -2.0 * twist * across)))


@kernel
def internal(nature: Any, state: Any, work: Any, rate: Any) -> None:
    """Every segment's force and stiffness, every node's bending tangent, into `work`."""
    last = state.shape[0] - 2
    before = direction(state, 0)
    ux, uz, inverse = before
    store(work, 0, at.TURN_X, -(uz * inverse))
    store(work, 0, at.TURN_Z, ux * inverse)
    here = direction(state, 1)
    left = bend(nature, state, work, 1, before, here, rate)
    for r in range(2, last + 1):
        ahead = direction(state, r)
        right = bend(nature, state, work, r, here, ahead, rate)
        pull(nature, state, work, r - 1, here, left - right)
        here, left = ahead, right
