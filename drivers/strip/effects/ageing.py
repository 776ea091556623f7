"""Ageing: loss of bending rigidity with every run of a specimen."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import CELLS, SOFTEST, StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    factor = max(SOFTEST, 1.0 - values["rate"] * model.index)
    return replace(model, mechanics=model.mechanics.scale_rigidity(np.full(CELLS, factor)))


EFFECT = Effect(
    name="ageing",
    sentence="the strip grows softer from run to run",
    of="strip",
    stage=Stage.LAW,
    parameters=(Parameter("rate", "1", low=-0.5, high=0.5),),
    apply=_apply,
    typical=lambda _: (0.003, 0.03),
    revealed_by="the first run of a series repeated as the last, and runs in shuffled order",
)
