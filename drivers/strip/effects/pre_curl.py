"""Pre-curl: a uniform rest curvature of the strip."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel
from drivers.types import frozen


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    mechanics = model.mechanics
    curved = frozen(mechanics.rest_curvature + values["curvature"])
    return replace(model, mechanics=replace(mechanics, rest_curvature=curved))


EFFECT = Effect(
    name="pre_curl",
    sentence="the strip curls by itself",
    of="strip",
    stage=Stage.LAW,
    parameters=(Parameter("curvature", "1/m", low=-60.0, high=60.0),),
    apply=_apply,
    typical=lambda _: (0.5, 5.0),
    textile={"curvature": Span(-5.0, 5.0)},
    revealed_by="a strip that hangs free; while both edges are clamped it shows little",
)
