"""Cables and hoses that pull a joint back like a spring."""

from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Fields, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _shape(mechanism: Mechanism) -> tuple[Parameter, ...]:
    size = 0.05 * np.ones(len(mechanism.joints))
    return per_joint(mechanism, "rest", "rad", size, signed=True, shape=True, high=120.0)


def law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of one joint, of floats or columns (m,); its parameters start at `p[at]`."""
    return -p[at] * (q - p[at + 1])


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    whole = EFFECT.table(mechanism, values)
    for i, joint in enumerate(mechanism.joints):
        added, rest = whole[:, i]
        if added != 0.0:
            had, at = fields["jnt_stiffness"][i], fields["qpos_spring"][joint.qpos]
            fields["qpos_spring"][joint.qpos] = (had * at + added * rest) / (had + added)
            fields["jnt_stiffness"][i] += added


EFFECT = Effect(
    name="cable_spring",
    sentence="cables pull joints back like springs",
    of="model",
    source="Hooke; MJCF joint/stiffness and springref",
    parameters=lambda m: per_joint(m, "stiffness", "N m/rad", 0.01 * m.torque),
    shape=_shape,
    keys=2,
    law=law,
    edit=_edit,
    revealed_by="slow motion over the whole range, there and back",
)
