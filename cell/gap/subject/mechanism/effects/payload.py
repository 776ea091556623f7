"""Unknown payload: the last body carries a point mass at its far end that the model lacks."""

import numpy as np

from cell.gap.subject.mechanism.bodies import add_point, tip
from cell.gap.subject.mechanism.effect import Effect, Fields, single
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    last = int(np.max(mechanism.model.jnt_bodyid))
    return single("mass", "kg", 0.01 * float(mechanism.model.body_mass[last]))


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    (mass,) = values
    if mass == 0.0:
        return
    body = int(np.max(mechanism.model.jnt_bodyid))
    add_point(fields, body, mass, tip(mechanism, body))


EFFECT = Effect(
    name="payload",
    sentence="the last body carries a mass that the model lacks",
    of="model",
    source="point mass at the farthest site or geom of the last body",
    parameters=_parameters,
    edit=_edit,
    revealed_by="the same motion at several speeds",
)
