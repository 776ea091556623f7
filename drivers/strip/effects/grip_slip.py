"""Slip of the strip out of the grip above a pulling force."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    boundary = replace(model.boundary, grip_force=values["force"])
    return replace(model, boundary=boundary)


EFFECT = Effect(
    name="grip_slip",
    sentence="the strip slides in the grip",
    of="cell",
    stage=Stage.BOUNDARY,
    parameters=(Parameter("force", "N", low=0.02, high=100.0, null=None),),
    apply=_apply,
    typical=lambda strip: tuple(strip.weight * n for n in (4.0, 2.4, 1.6, 1.2, 1.0, 0.8)),
    revealed_by="a taut lift, there and back: afterwards the strip is longer than before",
)
