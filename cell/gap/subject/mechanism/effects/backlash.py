"""Backlash: a gear has play, and its link moves freely within a gap."""

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Readings, has_gears, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


def _read(mechanism: Mechanism, values: Array, readings: Readings) -> None:
    readings.gap = values


EFFECT = Effect(
    name="backlash",
    sentence="gears have play",
    of="model",
    source="Nordin and Gutman 2002, Automatica 38",
    parameters=lambda m: (
        per_joint(m, "gap", "rad", 0.001 * np.ones(len(m.joints)), high=100.0)
        if has_gears(m)
        else ()
    ),
    read=_read,
    revealed_by="slow motion there and back through the load's turning point",
)
