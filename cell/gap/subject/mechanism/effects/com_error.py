"""Centre-of-mass error: the last body's centre of mass is not where the model states it."""

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Fields, single
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    size = 0.01 * max(float(np.abs(mechanism.model.body_ipos).max()), 0.01)
    return tuple(p for axis in "xyz" for p in single(axis, "m", size, signed=True))


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    body = int(np.max(mechanism.model.jnt_bodyid))
    for k, value in enumerate(values):
        if value != 0.0:
            fields["body_ipos"][body, k] += value


EFFECT = Effect(
    name="com_error",
    sentence="the last body's centre of mass is not where the model has it",
    of="model",
    source="first moments of a rigid body",
    parameters=_parameters,
    edit=_edit,
    revealed_by="slow motion through many poses",
    error_of="com",
)
