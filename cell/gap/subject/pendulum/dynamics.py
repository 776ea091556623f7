"""Free swing of planar chains of hinged links, many at once.

Absolute angles theta_i from upright, y up, x = sum l_j sin theta_j. Lagrange's equations of a
planar chain:

    sum_j a_ij cos(theta_i - theta_j) alpha_j + sum_j a_ij sin(theta_i - theta_j) omega_j^2
        - g b_i sin(theta_i + tilt) = Q_i

with a_ij = sum_k m_k d_ki d_kj + I_i delta_ij, b_i = sum_k m_k d_ki, and d_ki the lever of link i
on the mass of link k (its length for i < k, the com for i = k).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cell.gap.subject.pendulum.kernel import LAWS, integrate
from drivers.types import Array


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
    """States (steps + 1, 2, n, B) of chains let go at `angles`, `rates` (n, B), by RK4.

    Each chain moves bit for bit as it would alone.
    """
    n, count = angles.shape
    laws = [(LAWS.index(name), each) for name, each in chain.joint.items()]
    joint = np.array([each for _, each in laws]).reshape(len(laws), n, count)
    drag, tilt, compliance = (
        np.zeros(count) if each is None else each
        for each in (chain.drag, chain.tilt, chain.compliance)
    )
    states = integrate(
        _by_chain(chain.lever),
        _by_chain(chain.moment),
        chain.gravity,
        _by_chain(chain.length),
        np.array([number for number, _ in laws], dtype=np.int64),
        _by_chain(joint),
        drag,
        tilt,
        compliance,
        _by_chain(np.stack([angles, rates])),
        step,
        steps,
    )
    return np.moveaxis(states, 0, -1)


def _by_chain(values: Array) -> Array:
    """Values (..., B) with the chain first (B, ...)."""
    return np.ascontiguousarray(np.moveaxis(values, -1, 0))
