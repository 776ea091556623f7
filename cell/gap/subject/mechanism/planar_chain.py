"""Simulates planar chains of hinges without drives by their own equations of motion.

Links lie below one another in x and z, each with its centre of mass on its line.
Absolute angles theta_i from upright, z up, x = sum l_j sin theta_j. Lagrange's equations:

    sum_j a_ij cos(theta_i - theta_j) alpha_j + sum_j a_ij sin(theta_i - theta_j) omega_j^2
        - b_i (g_x cos theta_i - g_z sin theta_i) = Q_i

with levers a_ij = sum_k m_k d_ki d_kj + I_i delta_ij, moments b_i = sum_k m_k d_ki, and d_ki the
lever of link i on the mass of link k (its length for i < k, its centre of mass for i = k).
Arrays have the chain as first axis; a coefficient of zero switches a force off.
In the compiled functions arrays have the chain as first axis.
"""

import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise, repeat
from typing import Any

import numpy as np
from numba.core.errors import NumbaExperimentalFeatureWarning

from cell.gap.subject.mechanism.effects import torques
from cell.gap.subject.mechanism.engine import Case, Content
from cell.gap.subject.mechanism.fields import BatchFields
from cell.gap.subject.mechanism.forward import Forward
from cell.gap.subject.mechanism.load import MechanismData
from cell.gap.subject.mechanism.runs import falls
from cell.gap.subject.subject import Words
from drivers.strip.rod.compiled import entry, kernel
from drivers.types import Array

PIVOT_SPAN = 0.004  # s over which the pivot's acceleration is differenced
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(4)
OF_MODEL = ("body_mass", "body_inertia", "body_ipos", "body_pos", "dof_damping", "jnt_user")
DRAG, COMPLIANCE, END = "chain.drag", "chain.compliance", "chain.end"
ChainFields = dict[str, Array]
"""MuJoCo's fields by name, with the drag of air normal to the links [kg/m^2], the compliance of the
pivot in x [m/N], and where the last link ends [m] (NaN: like a uniform rod of its centre of mass
and inertia); each with the chain as its first axis.
"""


def fields_of(model: Any, count: int) -> ChainFields:
    """Fields of `count` equal chains, each with the chain as first axis, from a compiled model."""
    stated = {name: getattr(model, name) for name in OF_MODEL} | {"opt.gravity": model.opt.gravity}
    fields = {name: np.repeat(value[None], count, axis=0) for name, value in stated.items()}
    end = -model.site_pos[0, 2] if model.nsite else np.nan
    return fields | {DRAG: np.zeros(count), COMPLIANCE: np.zeros(count), END: np.full(count, end)}


def levers(fields: ChainFields) -> tuple[Array, Array, Array]:
    """Levers (B, n, n) [kg m^2], moments (B, n) [kg m] and lengths (B, n) [m] of the links."""
    # body 0 is the world, and body 1 hangs at the pivot; links point down, about y they turn
    mass, com = fields["body_mass"][:, 1:], -fields["body_ipos"][:, 1:, 2]
    inertia = fields["body_inertia"][:, 1:, 1]
    rod_end = np.minimum(2.0 * com, com + np.sqrt(3.0 * inertia / mass))[:, -1]
    end = np.where(np.isnan(fields[END]), rod_end, fields[END])
    length = np.column_stack([-fields["body_pos"][:, 2:, 2], end])
    count, n = mass.shape
    lever, moment = np.zeros((count, n, n)), np.zeros((count, n))
    for k in range(n):
        arms = [*length.T[:k], com[:, k]]
        for i, arm in enumerate(arms):
            moment[:, i] += mass[:, k] * arm
            for j, other in enumerate(arms):
                lever[:, i, j] += mass[:, k] * arm * other
        lever[:, k, k] += inertia[:, k]
    return lever, moment, length


def fastest(model: Any) -> float:
    """Angular frequency [rad/s] of the fastest small oscillation about hanging straight."""
    lever, moment, _ = levers(fields_of(model, 1))
    stiffness = np.diag(moment[0] * np.linalg.norm(model.opt.gravity))
    values = np.linalg.eigvals(np.linalg.solve(lever[0], stiffness))
    return float(np.sqrt(values.real.max()))


class PlanarChain(Forward):
    """Predicts the angles of planar chains by their equations of motion, whatever runs beside."""

    def __init__(self, opened: MechanismData, jobs: int, laws: frozenset[str]) -> None:
        super().__init__(opened, jobs, laws)
        with warnings.catch_warnings():  # laws are functions, and arguments of compiled ones
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
            self._simulate([])

    def _phases(self, content: Content) -> Words:
        """Phase (b,) of each sample, by whether the chain's centre of mass falls."""
        made = content.cut
        return falls(-self._mechanism.torque @ np.cos(made.values), made.edges)

    def _simulate(self, cases: Sequence[Case]) -> tuple[Array, Array, Any]:
        """States (n, steps + 1, 2, joints) of n cases, empty commands, and no models."""
        fields = fields_of(self._mechanism.model, len(cases))
        for i, case in enumerate(cases):
            case.edit(BatchFields(fields.__getitem__, i))
        start = np.array([case.start for case in cases]).reshape(-1, 2, self._mechanism.model.nq)
        span = max((float(case.content.cut.t[-1]) for case in cases), default=0.0)
        steps = int(np.ceil(span / self._mechanism.step)) + 1
        with ThreadPoolExecutor(self._jobs) as pool:
            edges = np.linspace(0, len(cases), self._jobs + 1).astype(int)
            parts = [slice(*pair) for pair in pairwise(edges)]  # one for each thread
            shares = [{name: values[part] for name, values in fields.items()} for part in parts]
            found = pool.map(self._swing, shares, [start[part] for part in parts], repeat(steps))
            states = np.concatenate(list(found))
        return states, np.zeros((len(cases), steps, 0)), None

    def _swing(self, own: ChainFields, start: Array, steps: int) -> Array:
        """States (k, steps + 1, 2, n) of the joints of k chains from `start` (k, 2, n)."""
        lever, moment, length = levers(own)
        absolute = np.cumsum(start, axis=2)  # the kernel's angles are from upright, no joint's
        absolute[:, 0] += np.pi
        states = integrate(
            torques().function(self._laws), lever, moment,
            np.ascontiguousarray(own["opt.gravity"][:, [0, 2]]), length, own["dof_damping"],
            own["jnt_user"], own[DRAG], own[COMPLIANCE], absolute, self._mechanism.step, steps,
        )  # fmt: skip
        states[:, :, 0] -= np.pi
        states[..., 1:] -= states[..., :-1].copy()
        return np.asarray(states)


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
