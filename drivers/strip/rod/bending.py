"""Forces and tangent stiffness of a planar rod: bending at nodes, stretch along
segments.
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
)
from drivers.strip.rod.terms import gradual_friction, lagging_moment, stick_slip


@kernel
def direction(state: Any, r: int) -> Any:
    """Unit tangent x, z, inverse length [1/m] and length [m] of the rod's
    segment `r`.
    """
    x, z = pair(state, r, at.X)
    next_x, next_z = pair(state, r + 1, at.X)
    ex = next_x - x
    ez = next_z - z
    length = sqrt(fma(ex, ex, ez * ez))
    inverse = 1.0 / length
    return ex * inverse, ez * inverse, inverse, length


@kernel
def strain(a: Any, b: Any) -> Any:
    """Bending strain 4 tan(theta / 4) between unit tangents `a` and `b`, and tan(theta
    / 4).

    Of the measures theta + O(theta^3), theta^3 / 48 comes close to the theta^3 / 36
    that cancels the error of second differences where an elastica is bent most, and
    needs no arc tangent. tan(theta / 4) = sine / (1 + cosine + sqrt(2 (1 + cosine))) of
    theta.
    """
    cosine = fma(a[0], b[0], a[1] * b[1])
    sine = fma(a[0], b[1], -(a[1] * b[0]))
    opened = 1.0 + cosine
    quarter = sine / (opened + sqrt(2.0 * opened))
    return 4.0 * quarter, quarter


@kernel
def _friction_element(stick: Any, slip: Any, change: Any, before: Any) -> Any:
    """Moment [N m] of an elastoplastic friction element after a `change` of strain, and
    its derivative by the strain.

    By return mapping: `stick` is its stiffness, `slip` the moment at which it slides,
    `before` its moment before the change.
    """
    moment = fma(stick, change, before)
    over = below(slip, moment)
    under = below(moment, -slip)
    moment = select(over, slip, select(under, -slip, moment))
    return moment, select(over + under, 0.0, stick)


@kernel
def dry_friction(block: Any, r: int, eps: Any) -> Any:
    """Moment [N m] of the friction element at node row `r` at bending strain `eps`, and
    its derivative by the strain.
    """
    stick = load(block.nature, r, at.STICK)
    slip = load(block.nature, r, at.SLIP)
    change = eps - load(block.state, r, at.EPS)
    return _friction_element(stick, slip, change, load(block.state, r, at.FRICTION))


@kernel
def _elastic_moment(block: Any, r: int, e: Any) -> Any:
    """Elastic moment K e (1 + u + fifth u^2) [N m] at node row `r` for bending strain
    e, with u = cubic e^2, and its derivative by e.
    """
    nature = block.nature
    stiffness = load(nature, r, at.BEND)
    cubic = load(nature, r, at.CUBIC)
    crest = load(nature, r, at.CREST)
    over = below(crest, e)
    under = below(e, -crest)
    e = select(over, crest, select(under, -crest, e))  # clamped: the moment stays level
    growth = cubic * e * e
    beyond = load(nature, r, at.FIFTH) * growth * growth
    slope = stiffness * (fma(3.0, growth, 1.0) + 5.0 * beyond)
    return stiffness * e * ((1.0 + growth) + beyond), select(over + under, 0.0, slope)


@kernel
def _moment(block: Any, r: int, eps: Any, rate: Any) -> Any:
    """Bending moment M(eps) [N m] of the rod at node row `r`, and its derivative
    dM/deps.

    M = K e (1 + u + fifth u^2) + D deps/dt + friction with u = cubic e^2, e = eps -
    rest and deps/dt = rate (eps - base).
    """
    elastic, elastic_slope = _elastic_moment(
        block, r, eps - load(block.nature, r, at.REST)
    )
    dry, dry_slope = dry_friction(block, r, eps)
    damping = load(block.nature, r, at.DAMP) * rate
    change = eps - load(block.work, r, at.BASE_EPS)
    total = elastic + damping * change + dry
    slope = elastic_slope + damping + dry_slope
    if block.terms is not None:
        lagging, lagging_slope = lagging_moment(block, r, change, rate)
        gradual, gradual_slope = gradual_friction(block, r, eps)
        total = total + lagging + gradual
        slope = slope + lagging_slope + gradual_slope

    return total, slope


@kernel
def _node_moment(block: Any, r: int, a: Any, b: Any, rate: Any) -> Any:
    """Moment [N m] of the rod on its angle at node row `r`, between segments with unit
    tangents `a` and `b`.

    With q = tan(theta / 4): deps/dtheta = 1 + q^2, d2eps/dtheta2 = q (1 + q^2) / 2.
    Leaves the tangent d(moment)/dtheta in `work`.
    """
    eps, quarter = strain(a, b)
    value, slope = _moment(block, r, eps, rate)
    first = fma(quarter, quarter, 1.0)
    second = 0.5 * quarter * first
    store(block.work, r, at.TANGENT, fma(slope * first, first, value * second))
    return value * first


@kernel
def _segment_turn(work: Any, r: int, u: Any) -> Any:
    """Turn (x, z) [rad/m] of the rod's segment `r` with unit tangent `u` per motion of
    its end, also written into `work`.
    """
    turn = -(u[1] * u[2]), u[0] * u[2]
    store_pair(work, r, at.TURN_X, turn)
    return turn


@kernel
def _segment_force(block: Any, r: int, u: Any, couple: Any) -> None:
    """Write into the block's `work` the force [N] of the rod's segment `r` on its first
    node, and its 2 x 2 stiffness.

    f = T t + V n with tension T = EA (l / l0 - 1) and shear V = couple / l, couple the
    difference of the moments at its ends; df/de = EA/l0 t t' + T/l n n' + couple
    d2angle/de2. The T of the stiffness is the one of the last linear solution, an
    unknown of its own: so an almost inextensible segment turns without Newton mistaking
    the turn for tension. It counts as no less than FLOOR, because a segment pressed
    harder buckles.
    """
    nature = block.nature
    work = block.work
    ux, uz, inverse, length = u

    stretch = load(nature, r, at.STRETCH)
    taut = stretch * (length - load(nature, r, at.SPAN))
    if block.terms is not None:
        taut, stretch = stick_slip(block, r, taut, stretch, length)
    floor = load(nature, r, at.FLOOR)
    tension = load(block.state, r, at.TENSION)
    string = select(tension - floor, tension, floor) * inverse
    twist = couple * inverse * inverse

    turn_x, turn_z = _segment_turn(work, r, u)
    store_pair(work, r, at.TAUT, (taut, stretch * length))
    pull = fma(taut, ux, couple * turn_x), fma(taut, uz, couple * turn_z)
    store_pair(work, r, at.PULL_X, pull)

    xx = ux * ux
    xz = ux * uz
    zz = uz * uz
    store(work, r, at.S_XX, fma(stretch, xx, fma(string, zz, 2.0 * twist * xz)))
    store(work, r, at.S_XZ, fma(stretch - string, xz, twist * (zz - xx)))
    store(work, r, at.S_ZZ, fma(stretch, zz, fma(string, xx, -2.0 * twist * xz)))


@kernel
def _extend_free_end(state: Any) -> None:
    """Place the ghost node beyond a strip's free end in line with its last segment."""
    ghost = state.shape[0] - 1
    for axis in (at.X, at.Z):
        end = load(state, ghost - 1, axis)
        before = load(state, ghost - 2, axis)
        store(state, ghost, axis, 2.0 * end - before)


@kernel
def internal_forces(block: Any, rate: Any) -> None:
    """Write the forces and stiffness of all the rod's segments, and the bending
    tangents of its nodes, into the block's `work`.
    """
    state = block.state
    end = state.shape[0] - 2
    if block.last == end:
        _extend_free_end(state)

    last_tangent = direction(state, 0)
    tangent = direction(state, 1)
    _segment_turn(block.work, 0, last_tangent)
    moment_left = _node_moment(block, 1, last_tangent, tangent, rate)

    for r in range(at.FIRST_FREE_NODE, end + 1):
        next_tangent = direction(state, r)
        moment_right = _node_moment(block, r, tangent, next_tangent, rate)
        _segment_force(block, r - 1, tangent, moment_left - moment_right)
        tangent, moment_left = next_tangent, moment_right
