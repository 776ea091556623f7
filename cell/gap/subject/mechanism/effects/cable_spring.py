"""Cable stiffness: cables and hoses pull a joint back like a linear spring."""

from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Fields, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


def law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Spring torque [N m] of a joint, from floats or columns (m,); its values begin at `p[at]`."""
    return -p[at] * (q - p[at + 1])


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    """Add a spring in parallel to each joint's own, at their common position of rest."""
    table = EFFECT.table(mechanism, values)
    for i, joint in enumerate(mechanism.joints):
        added, rest = table[:, i]
        if added != 0.0:
            own, own_rest = fields["jnt_stiffness"][i], fields["qpos_spring"][joint.qpos]
            common_rest = (own * own_rest + added * rest) / (own + added)
            fields["qpos_spring"][joint.qpos] = common_rest
            fields["jnt_stiffness"][i] += added


EFFECT = Effect(
    name="cable_spring",
    sentence="cables pull joints back like springs",
    of="model",
    source="Hooke; MJCF joint/stiffness and springref",
    parameters=lambda m: per_joint(m, "stiffness", "N m/rad", 0.01 * m.torque),
    shape=lambda m: per_joint(m, "rest", "rad", 0.05 * np.ones(len(m.joints)), signed=True,
                              shape=True, high=120.0),
    keys=2,
    law=law,
    edit=_edit,
    revealed_by="slow motion over the whole range, there and back",
)  # fmt: skip
