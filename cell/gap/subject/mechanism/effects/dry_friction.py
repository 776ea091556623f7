"""Dry friction of joints: Coulomb friction with Stribeck peak, asymmetry and load dependence."""

from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import MODES, Effect, add_to, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array

STRIBECK = 0.1  # of the typical rate, where a Stribeck peak begins


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Friction torque of each joint, and its share per load where the load of gears is known."""
    torques = per_joint(mechanism, "torque", "N m", 0.01 * mechanism.torque)
    return torques + (_loads(mechanism) if mechanism.mode == "prescribed" else ())


def _loads(mechanism: Mechanism) -> tuple[Parameter, ...]:
    ones = np.ones(len(mechanism.joints))
    return per_joint(mechanism, "load", "1", 0.01 * ones, high=100.0)


def _shape(mechanism: Mechanism) -> tuple[Parameter, ...]:
    """Shape of each joint's law: load, asymmetry, Stribeck peak; none for a pendulum."""
    if mechanism.mode == "planar":
        return ()
    ones = np.ones(len(mechanism.joints))
    rates = [
        Parameter(f"stribeck_velocity_{j.name}", "rad/s" if j.hinge else "m/s",
                  v, 0.1 * v, 10.0 * v, step=0.01 * v, spread=v, shape=True)
        for j, v in zip(mechanism.joints, STRIBECK * mechanism.rate, strict=True)
    ]  # fmt: skip
    return (
        *(_loads(mechanism) if mechanism.mode == "forward" else ()),
        *per_joint(mechanism, "asymmetry", "1", 0.02 * ones, signed=True, shape=True, high=45.0),
        *per_joint(mechanism, "stribeck_torque", "N m", 0.01 * mechanism.torque, shape=True),
        *rates,
    )


def law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Friction torque [N m] of a joint, of floats or columns (m,); its values begin at `p[at]`."""
    size = p[at] + p[at + 1] * abs(load)
    if p[at + 3] != 0.0:
        size += p[at + 3] * np.exp(-((v / p[at + 4]) ** 2))
    sign = np.tanh(v / p[3])
    return -size * (sign + p[at + 2] * abs(sign))


def _largest(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Largest torque [N m] by which friction can hold a joint that stands."""
    return p[at] + p[at + 1] * abs(load) + p[at + 3] * np.exp(-((v / p[at + 4]) ** 2))


EFFECT = Effect(
    name="dry_friction",
    sentence="joints rub like dry friction",
    of="model",
    source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30; load: arXiv 2410.08650",
    parameters=_parameters,
    shape=_shape,
    keys=5,
    law=law,
    edit=add_to("dof_frictionloss"),
    holds=_largest,
    native=lambda m: m.native,
    modes=MODES,
    revealed_by="slow motion there and back: the torque jumps with the sign of the rate",
)
