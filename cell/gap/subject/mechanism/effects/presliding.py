"""Presliding friction: a joint yields like a spring before it slides."""

import numba
import numpy as np

from cell.gap.subject.mechanism.effect import Effect, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array

# rad or m within which it yields whatever its stiffness: beyond, it is a spring and no friction.
# Source: Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30: motions of microns at the
# teeth of a gear, of millimetres at the tip of an arm
YIELD = 0.02


def _shape(mechanism: Mechanism) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"torque_{j.name}", "N m", 0.05 * j.torque, 0.001 * j.torque, j.torque,
                  step=0.001 * j.torque, spread=0.1 * j.torque, shape=True)
        for j in mechanism.joints
    )  # fmt: skip


def _path(mechanism: Mechanism, values: Array, q: Array, v: Array) -> Array:
    stiffness, torque = EFFECT.table(mechanism, values)
    return np.asarray(_yielding(q, stiffness, np.minimum(torque, YIELD * stiffness)))


@numba.njit  # type: ignore[untyped-decorator]
def _yielding(q: Array, stiffness: Array, most: Array) -> Array:
    """Torques (m, joints) of elastic, perfectly plastic elements along a motion q (m, joints)."""
    out = np.zeros_like(q)
    for j in range(q.shape[1]):
        if stiffness[j] == 0.0:
            continue
        torque = 0.0
        for k in range(1, q.shape[0]):
            torque -= stiffness[j] * (q[k, j] - q[k - 1, j])
            torque = min(max(torque, -most[j]), most[j])
            out[k, j] = torque
    return out


EFFECT = Effect(
    name="presliding",
    sentence="joints yield like springs before they slide",
    of="model",
    source="Dahl 1968, TOR-0158; Prandtl's elastic, perfectly plastic element",
    parameters=lambda m: per_joint(m, "stiffness", "N m/rad", 0.1 * m.torque, high=1000.0),
    shape=_shape,
    path=_path,
    modes=("prescribed",),
    revealed_by="small motion there and back",
)
