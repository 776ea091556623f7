"""Rotational compliance of the grip under the strip's moment."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel

SHARP_CURVATURE = 50.0  # 1/m, a sharp bend of a fold


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    boundary = replace(model.boundary, grip_compliance=values["compliance"])
    return replace(model, boundary=boundary)


EFFECT = Effect(
    name="gripper_compliance",
    sentence="the grip turns under the moment of the strip",
    of="cell",
    stage=Stage.BOUNDARY,
    parameters=(Parameter("compliance", "rad/(N m)", low=0.0, high=1e4),),
    apply=_apply,
    typical=lambda strip: tuple(turn / (strip.rigidity * SHARP_CURVATURE) for turn in (0.01, 0.1)),
    revealed_by="a stiff strip folded beside a soft one",
)
