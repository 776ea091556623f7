"""A gear with play: the link is free within a gap."""

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Readings, has_gears, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    if not has_gears(mechanism):
        return ()
    size = 0.001 * np.ones(len(mechanism.joints))
    return per_joint(mechanism, "gap", "rad", size, high=100.0)


def _read(mechanism: Mechanism, values: Array, readings: Readings) -> None:
    readings.gap = values


EFFECT = Effect(
    name="backlash",
    sentence="gears have play",
    of="model",
    source="Nordin and Gutman 2002, Automatica 38",
    parameters=_parameters,
    read=_read,
    revealed_by="slow motion there and back through the load's turning point",
)
