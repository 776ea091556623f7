"""Compiled integration of the motion of planar chains of hinged links, chain after chain.

Absolute angles theta_i from upright, z up, x = sum l_j sin theta_j. Lagrange's equations:

    sum_j a_ij cos(theta_i - theta_j) alpha_j + sum_j a_ij sin(theta_i - theta_j) omega_j^2
        - b_i (g_x cos theta_i - g_z sin theta_i) = Q_i

with levers a_ij = sum_k m_k d_ki d_kj + I_i delta_ij, moments b_i = sum_k m_k d_ki, and d_ki the
lever of link i on the mass of link k (its length for i < k, its centre of mass for i = k).
Arrays have the chain as first axis; a coefficient of zero switches a force off.
"""

import numpy as np

from drivers.strip.rod.compiled import entry, kernel
from drivers.types import Array

PIVOT_SPAN = 0.004  # s over which the pivot's acceleration is differenced
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(4)


@kernel
def _add_joints(law, damping: Array, user: Array, y: Array, force: Array) -> None:  # type: ignore[no-untyped-def]
    """Add the torques of all joints to the generalised `force` (n,)."""
    n = len(force)
    for i in range(n):
        rate = y[1, i] - (y[1, i - 1] if i else 0.0)
        bend = y[0, i] - (y[0, i - 1] if i else np.pi)
        torque = law(bend, rate, 0.0, user[i]) - damping[i] * rate
        force[i] += torque
        if i:
            force[i - 1] -= torque


@kernel
def _add_drag(drag: float, length: Array, s: Array, c: Array, omega: Array, force: Array) -> None:
    """Add a force -drag |v_n| v_n per length, normal to each link, to `force` (n,)."""
    vx = vy = 0.0
    for k in range(len(force)):
        half = 0.5 * length[k]
        across = vx * c[k] - vy * s[k]
        resultant = torque = 0.0
        for q in range(len(POINTS)):
            arm = half * (1.0 + POINTS[q])
            v = across + arm * omega[k]
            f = -half * drag * WEIGHTS[q] * abs(v) * v
            resultant += f
            torque += f * arm
        force[k] += torque
        for i in range(k):
            force[i] += resultant * length[i] * (c[i] * c[k] + s[i] * s[k])
        vx += length[k] * omega[k] * c[k]
        vy -= length[k] * omega[k] * s[k]


@kernel
def _solve(a: Array, x: Array) -> None:
    """Solve the symmetric positive system `a` (n, n) in place of its right side `x` (n,)."""
    n = len(x)
    for k in range(n):
        for i in range(k + 1, n):
            ratio = a[i, k] / a[k, k]
            for j in range(k, n):
                a[i, j] -= ratio * a[k, j]
            x[i] -= ratio * x[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= a[k, j] * x[j]
        x[k] /= a[k, k]


@kernel
def _rigid(chain: tuple, y: Array, push: float, out: Array) -> None:  # type: ignore[type-arg]
    """Write the rate of state `y` (2, n) to `out`, with the pivot accelerated by `push` [m/s^2]."""
    law, lever, moment, gravity, length, damping, user, drag, (s, c, inertia) = chain
    n = len(moment)
    force = out[1]
    for i in range(n):
        s[i], c[i] = np.sin(y[0, i]), np.cos(y[0, i])
    for i in range(n):
        total = 0.0
        for j in range(n):
            inertia[i, j] = lever[i, j] * (c[i] * c[j] + s[i] * s[j])
            total += lever[i, j] * (s[i] * c[j] - c[i] * s[j]) * (y[1, j] * y[1, j])
        force[i] = moment[i] * ((gravity[0] - push) * c[i] - gravity[1] * s[i]) - total
        out[0, i] = y[1, i]
    _add_joints(law, damping, user, y, force)
    if drag != 0.0:
        _add_drag(drag, length, s, c, y[1], force)
    _solve(inertia, force)


@kernel
def _pull(moment: Array, y: Array, rate: Array) -> float:
    """Horizontal pull X'' [N] of a chain in state `y` (2, n) with `rate` (2, n), at its pivot."""
    pull = 0.0
    for i in range(len(moment)):
        pull += moment[i] * (np.cos(y[0, i]) * rate[1, i] - np.sin(y[0, i]) * y[1, i] ** 2)
    return pull


@kernel
def _pivot(chain: tuple, compliance: float, y: Array) -> float:  # type: ignore[type-arg]
    """Acceleration [m/s^2] of a compliant pivot, which to first order follows the pull at once.

    u = -C X'' with X = sum b_i sin theta_i, so that its acceleration is -C (X'')'' along the
    rigid motion, differenced over +-PIVOT_SPAN by midpoint steps.
    """
    moment = chain[2]
    rigid, rate, ahead = np.empty_like(y), np.empty_like(y), np.empty_like(y)
    _rigid(chain, y, 0.0, rigid)
    here = _pull(moment, y, rigid)
    around = 0.0
    for h in (PIVOT_SPAN, -PIVOT_SPAN):
        _advance_state(y, 0.5 * h, rigid, ahead)
        _rigid(chain, ahead, 0.0, rate)
        _advance_state(y, h, rate, ahead)
        _rigid(chain, ahead, 0.0, rate)
        around += _pull(moment, ahead, rate)
    return -compliance * (around - 2.0 * here) / PIVOT_SPAN**2


@kernel
def _advance_state(y: Array, h: float, rate: Array, out: Array) -> None:
    """Write into `out` (2, n) the state `y` advanced by `h` [s] at `rate`."""
    for i in range(y.shape[1]):
        out[0, i] = y[0, i] + h * rate[0, i]
        out[1, i] = y[1, i] + h * rate[1, i]


@kernel
def _advance(  # type: ignore[no-untyped-def]
    chain, y: Array, h: float, push: float, rise: float, k: Array, out: Array
) -> None:
    """Advance the state `y` (2, n) by one RK4 step of `h` [s] into `out`.

    The pivot's acceleration `push` [m/s^2] goes on to `rise` as in the last step. `k` (5, 2, n) is
    working memory for four rates and a state.
    """
    half, end = push + 0.5 * rise, push + rise
    _rigid(chain, y, push, k[0])
    _advance_state(y, 0.5 * h, k[0], k[4])
    _rigid(chain, k[4], half, k[1])
    _advance_state(y, 0.5 * h, k[1], k[4])
    _rigid(chain, k[4], half, k[2])
    _advance_state(y, h, k[2], k[4])
    _rigid(chain, k[4], end, k[3])
    for r in range(2):
        for i in range(y.shape[1]):
            slope = k[0, r, i] + 2.0 * (k[1, r, i] + k[2, r, i]) + k[3, r, i]
            out[r, i] = y[r, i] + (h / 6.0) * slope


@entry
def integrate(  # type: ignore[no-untyped-def]
    law, lever: Array, moment: Array, gravity: Array, length: Array, damping: Array, user: Array,
    drag: Array, compliance: Array, initial: Array, step: float, steps: int,
) -> Array:  # fmt: skip
    """States (B, steps + 1, 2, n) of B chains from `initial` (B, 2, n), by RK4 with `step` [s].

    Of each chain: `lever` (n, n), `moment`, `length`, `damping` (n,), numbers `user` (n, slots) of
    the compiled `law` of its joints, `gravity` (2,) in x and z, `drag` [kg/m^2] normal to the links
    and `compliance` of the pivot [m/N].
    """
    count, _, n = initial.shape
    states = np.empty((count, steps + 1, 2, n))
    work, k = (np.empty(n), np.empty(n), np.empty((n, n))), np.empty((5, 2, n))
    for b in range(count):
        own = (law, lever[b], moment[b], gravity[b], length[b], damping[b], user[b], drag[b], work)
        states[b, 0] = initial[b]
        before = 0.0
        for i in range(steps):
            y = states[b, i]
            push = 0.0 if compliance[b] == 0.0 else _pivot(own, compliance[b], y)
            rise = 0.0 if i == 0 else push - before
            _advance(own, y, step, push, rise, k, states[b, i + 1])
            before = push
    return states
