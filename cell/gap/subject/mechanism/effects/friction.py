"""Effects of friction: dry, quadratic, presliding, and of contacts.

Sources: Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30 (dry); arXiv
2410.08650 (its load); Dahl 1968, TOR-0158, and Prandtl's elastic, perfectly plastic
element (presliding).
"""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from cell.gap.subject.mechanism.effect import (
    MechanismEffect,
    add_to,
    per_joint,
    shapes,
    single_parameter,
)
from cell.gap.subject.mechanism.model import MODES, PRESCRIBED, Mechanism
from drivers.base.jit import entry
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

STRIBECK = 0.1  # of the typical rate, where a Stribeck peak begins
# rad or m within which a joint yields whatever its stiffness: beyond, it is a spring,
# no friction. Source: Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30:
# motions of microns at the teeth of a gear, of millimetres at the tip of an arm
YIELD = 0.02


def _dry_parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Parameters of dry friction: its torque [N m] in each joint and, where the gear's
    load is known, its increase per unit of that load.
    """
    torques = per_joint(mechanism, "torque", "N m", 0.01 * mechanism.torque)
    return torques + (_loads(mechanism) if mechanism.mode.loads else ())


def _loads(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Parameters of friction that grows with load: the friction torque of each joint
    per unit of the torque that its gear bears.
    """
    ones = np.ones(len(mechanism.joints))
    return per_joint(mechanism, "load", "1", 0.01 * ones, high=100.0)


def _dry_shape(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Parameters that shape dry friction in each joint: its increase with load, its
    asymmetry between directions, and the height and width of its peak at low rates,
    named after Stribeck.
    """
    joints = mechanism.joints
    torque = 0.01 * mechanism.torque
    signs = 0.02 * np.ones(len(joints))
    starts = STRIBECK * mechanism.rate
    return (
        *(() if mechanism.mode.loads else _loads(mechanism)),
        *per_joint(
            mechanism, "asymmetry", "1", signs, signed=True, role="shape", high=45.0
        ),
        *per_joint(mechanism, "stribeck_torque", "N m", torque, role="shape"),
        *shapes(
            joints,
            key="stribeck_velocity",
            unit="rad/s",
            starts=starts,
            bounds=(0.1, 10.0),
            step=0.01,
        ),
    )


def dry_law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of dry friction against the rates `v`, of the same shape as these:
    constant but for growth with `load`, a peak at low rates, and another size in each
    direction.
    """
    sign = np.tanh(v / p[1])
    return -dry_limit(q, v, load, p, at) * (sign + p[at + 2] * abs(sign))


@register_jitable  # type: ignore[untyped-decorator]
def dry_limit(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Size [N m] of dry friction at joint rates `v` and gear loads `load`, of the same
    shape as these; of a joint at rest it is the largest torque that friction
    withstands.
    """
    peak = p[at + 3] * np.exp(-((v / p[at + 4]) ** 2)) if p[at + 3] else 0.0
    return p[at] + p[at + 1] * abs(load) + peak


def _quadratic_law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of quadratic friction at joint rates `v` [rad/s]: minus the
    parameter `p[at]` times the square of the rate, with the rate's sign.
    """
    return -p[at] * abs(v) * v


def _presliding_shape(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Parameters that shape friction before sliding: the torque [N m] at which the
    elastic contacts of each joint begin to slide.
    """
    starts = 0.05 * mechanism.torque
    bounds = (0.02, 20.0)
    return shapes(
        mechanism.joints,
        key="torque",
        unit="N m",
        starts=starts,
        bounds=bounds,
        step=0.02,
        spread=2.0,
    )


def _presliding_path(
    mechanism: Mechanism, values: Array, t: Array, q: Array, v: Array
) -> Array:
    stiffness, torque = PRESLIDING.table(mechanism, values)
    return _yielding(q, stiffness, np.minimum(torque, YIELD * stiffness))


@entry
def _yielding(q: Array, stiffness: Array, most: Array) -> Array:
    """Torques of one elastic, perfectly plastic element in each joint, a row for each
    time and a column for each joint, along the joint positions `q` of the same shape.
    """
    out = np.zeros_like(q)
    for k in range(1, len(q)):
        stretched = out[k - 1] - stiffness * (q[k] - q[k - 1])
        out[k] = np.minimum(np.maximum(stretched, -most), most)
    return out


def _edit_pairs(mechanism: Mechanism, values: Array, edited: Any) -> None:
    edited.pair_friction[:, :2] += values[0]


DRY_FRICTION = MechanismEffect(
    name="dry_friction",
    sentence="joints rub like dry friction",
    parameters=_dry_parameters,
    shape=_dry_shape,
    keys=5,
    law=dry_law,
    edit=add_to("dof_frictionloss"),
    edited=1,
    modes=MODES,
    revealed_by=(
        "slow motion there and back: the torque jumps with the sign of the rate"
    ),
)
QUADRATIC_DAMPING = MechanismEffect(
    name="quadratic_damping",
    sentence="joints brake with the square of their rate",
    parameters=lambda m: per_joint(
        m, "coefficient", "N m s^2", 0.01 * m.torque / m.rate**2
    ),
    law=_quadratic_law,
    edit=add_to("dof_dampingpoly"),
    modes=MODES,
    revealed_by="fast motion against slow",
)
PRESLIDING = MechanismEffect(
    name="presliding",
    sentence="joints yield like springs before they slide",
    parameters=lambda m: per_joint(
        m, "stiffness", "N m/rad", 0.1 * m.torque, high=1000.0
    ),
    shape=_presliding_shape,
    path=_presliding_path,
    modes=(PRESCRIBED.name,),
    revealed_by="small motion there and back",
)
CONTACT_FRICTION = MechanismEffect(
    name="contact_friction",
    sentence="contacts rub more or less than stated",
    parameters=lambda _: single_parameter(
        "coefficient", "1", 0.01, signed=True, high=50.0
    ),
    possible=lambda m: bool(m.model.npair),
    edit=_edit_pairs,
    revealed_by="slide slowly along the contact",
)
