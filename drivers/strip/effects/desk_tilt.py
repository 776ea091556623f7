"""Desk tilt: a slope along the strip, which turns gravity in the cell frame."""

import math
from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    weight = math.hypot(*model.boundary.gravity)
    pull = (weight * math.sin(values["angle"]), -weight * math.cos(values["angle"]))
    return replace(model, boundary=replace(model.boundary, gravity=pull))


EFFECT = Effect(
    name="desk_tilt",
    sentence="the desk leans, so that weight pulls along the strip",
    of="cell",
    stage=Stage.BOUNDARY,
    parameters=(Parameter("angle", "rad", low=-0.2, high=0.2),),
    apply=_apply,
    typical=lambda _: (0.003, -0.01, 0.02),
    revealed_by="a spirit level; the strip turned by 180 degrees",
)
