"""Slip of a loose fixed edge on the desk, with Coulomb friction."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    boundary = replace(model.boundary, edge_friction=values["friction"])
    return replace(model, boundary=boundary)


EFFECT = Effect(
    name="end_slip",
    sentence="the fixed edge slides on the desk",
    of="cell",
    stage=Stage.BOUNDARY,
    parameters=(Parameter("friction", "1", low=0.05, high=10.0, null=None),),
    apply=_apply,
    typical=lambda _: (10.0, 3.0, 1.5, 0.8),
    revealed_by="a taut lift, and a picture of the fixed edge before and after",
)
