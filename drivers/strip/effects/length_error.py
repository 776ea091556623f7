"""Difference between the strip's true and stated length."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    length = model.stated_length + values["error"]
    return replace(model, mechanics=replace(model.mechanics, length=length))


EFFECT = Effect(
    name="length_error",
    sentence="the strip is not as long as stated",
    of="strip",
    stage=Stage.SIZE,
    parameters=(Parameter("error", "m", low=-0.02, high=0.02),),
    apply=_apply,
    typical=lambda _: (0.0005, -0.002, 0.003),  # too short it is taut, too long it buckles
    textile={"error": Span(-0.001, 0.002)},
    revealed_by="a ruler; a taut lift: slack or pull before the strip hangs",
)
