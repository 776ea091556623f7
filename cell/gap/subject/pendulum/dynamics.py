"""Free swing of planar chains of hinged links, many at once.

Absolute angles theta_i from upright, y up, x = sum l_j sin theta_j. Lagrange's equations of a
planar chain, all arrays with the swing as last axis:

    sum_j a_ij cos(theta_i - theta_j) alpha_j + sum_j a_ij sin(theta_i - theta_j) omega_j^2
        - g b_i sin(theta_i + tilt) = Q_i

with a_ij = sum_k m_k d_ki d_kj + I_i delta_ij, b_i = sum_k m_k d_ki, and d_ki the lever of link i
on the mass of link k (its length for i < k, the com for i = k).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from drivers.types import Array

SMOOTH = 0.02  # rad/s over which dry friction changes sign
REACH = 0.004  # s over which the pivot's acceleration is differenced
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(4)

LAWS: Mapping[str, Callable[[Array, Array], Array]] = {
    "viscous": lambda rate, _: rate,
    "dry": lambda rate, _: np.tanh(rate / SMOOTH),
    "quadratic": lambda rate, _: np.abs(rate) * rate,
    "cubic": lambda rate, _: rate**3,
    "spring": lambda _, bend: bend,
    "cubic_spring": lambda _, bend: bend**3,
    "bent_viscous": lambda rate, bend: np.abs(bend) * rate,
    "constant": lambda rate, _: np.ones_like(rate),
}
"""Torques that oppose a joint, of its relative rate and of its bend from hanging straight."""


@dataclass(frozen=True, slots=True)
class Swings:
    """B chains of n links, ready to move. Shapes (n, B) unless stated.

    `lever` (n, n, B) a_ij, `moment` b_i [kg m], `gravity` (B,), `length` of each link (of the
    last one: where its drag ends) [m], `joint` coefficients of LAWS by name, `drag` (B,)
    [kg/m^2], `tilt` (B,) [rad], `compliance` (B,) [m/N]. None: absent.
    """

    lever: Array
    moment: Array
    gravity: Array
    length: Array
    joint: Mapping[str, Array] = field(default_factory=dict)
    drag: Array | None = None
    tilt: Array | None = None
    compliance: Array | None = None


def swing(chain: Swings, angles: Array, rates: Array, step: float, steps: int) -> Array:
    """States (steps + 1, 2, n, B) of chains let go at `angles`, `rates` (n, B), by RK4."""
    states = np.empty((steps + 1, 2, *angles.shape))
    states[0, 0], states[0, 1] = angles, rates
    before: Array | None = None
    for i in range(steps):
        push = None if chain.compliance is None else _pivot(chain, states[i])
        rise = np.zeros(()) if push is None or before is None else push - before
        states[i + 1] = _rk4(chain, states[i], step, push, rise)
        before = push
    return states


def _rk4(chain: Swings, y: Array, h: float, push: Array | None, rise: Array) -> Array:
    """One step; the pivot's acceleration `push` goes on rising as it did in the last step."""
    half, end = (None, None) if push is None else (push + 0.5 * rise, push + rise)
    k1 = _rigid(chain, y, push)
    k2 = _rigid(chain, y + (0.5 * h) * k1, half)
    k3 = _rigid(chain, y + (0.5 * h) * k2, half)
    k4 = _rigid(chain, y + h * k3, end)
    return y + (h / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)


def _rigid(chain: Swings, y: Array, push: Array | None = None) -> Array:
    """Rate of change of a state; `push` (B,) [m/s^2] is the pivot's acceleration along x."""
    theta, omega = y
    s, c = np.sin(theta), np.cos(theta)
    inertia = chain.lever * (c[:, None] * c[None] + s[:, None] * s[None])
    skew = chain.lever * (s[:, None] * c[None] - c[:, None] * s[None])
    force = _gravity(chain, s, c) - (skew * (omega * omega)[None]).sum(axis=1)
    force += _joints(chain, theta, omega)
    if chain.drag is not None:
        force += _drag(chain, s, c, omega)
    if push is not None:
        force -= chain.moment * c * push
    out = np.empty_like(y)
    out[0], out[1] = omega, _solve(inertia, force)
    return out


def _gravity(chain: Swings, s: Array, c: Array) -> Array:
    weight = chain.moment * chain.gravity
    if chain.tilt is None:
        return weight * s
    return weight * (s * np.cos(chain.tilt) + c * np.sin(chain.tilt))


def _joints(chain: Swings, theta: Array, omega: Array) -> Array:
    rate, bend = omega.copy(), theta.copy()
    rate[1:] -= omega[:-1]
    bend[0] -= np.pi
    bend[1:] -= theta[:-1]
    torque = np.zeros_like(rate)
    for name, coefficient in chain.joint.items():
        torque -= coefficient * LAWS[name](rate, bend)
    torque[:-1] -= torque[1:].copy()
    return torque


def _drag(chain: Swings, s: Array, c: Array, omega: Array) -> Array:
    """Generalised forces of a force -drag |v_n| v_n per length, normal to each link."""
    forces = np.zeros_like(omega)
    vx, vy = np.zeros_like(omega[0]), np.zeros_like(omega[0])
    for k in range(len(omega)):
        half = 0.5 * chain.length[k]
        arms = half * (1.0 + POINTS)[:, None]
        v = vx * c[k] - vy * s[k] + arms * omega[k]
        f = (-half * chain.drag) * WEIGHTS[:, None] * np.abs(v) * v
        resultant, torque = f.sum(axis=0), (f * arms).sum(axis=0)
        forces[k] += torque
        for i in range(k):
            forces[i] += resultant * chain.length[i] * (c[i] * c[k] + s[i] * s[k])
        vx = vx + chain.length[k] * omega[k] * c[k]
        vy = vy - chain.length[k] * omega[k] * s[k]
    return forces


def _pivot(chain: Swings, y: Array) -> Array:
    """Acceleration of a compliant pivot (B,): to first order it follows the pull at once.

    u = -C X'' with X = sum b_i sin theta_i, so that its acceleration is -C (X'')'' along the
    rigid motion, differenced over +-REACH by midpoint steps.
    """
    rigid = _rigid(chain, y)
    here = _pull(chain, y, rigid)
    around = np.zeros_like(here)
    for h in (REACH, -REACH):
        ahead = y + h * _rigid(chain, y + (0.5 * h) * rigid)
        around += _pull(chain, ahead, _rigid(chain, ahead))
    compliance = np.zeros_like(here) if chain.compliance is None else chain.compliance
    return -compliance * (around - 2.0 * here) / REACH**2


def _pull(chain: Swings, y: Array, rate: Array) -> Array:
    theta, omega = y
    pull = chain.moment * (np.cos(theta) * rate[1] - np.sin(theta) * omega**2)
    return np.asarray(pull.sum(axis=0))


def _solve(matrix: Array, right: Array) -> Array:
    """Solution of (n, n, B) symmetric positive systems by elimination without pivoting."""
    a, x = matrix, right
    n = len(x)
    for k in range(n):
        for i in range(k + 1, n):
            ratio = a[i, k] / a[k, k]
            a[i, k:] -= ratio * a[k, k:]
            x[i] -= ratio * x[k]
    for k in reversed(range(n)):
        for j in range(k + 1, n):
            x[k] -= a[k, j] * x[j]
        x[k] /= a[k, k]
    return x
