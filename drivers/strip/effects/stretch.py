"""Elastic stretch of the strip under tension."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    mechanics = replace(model.mechanics, stretch_stiffness=values["stiffness"])
    return replace(model, mechanics=mechanics)


EFFECT = Effect(
    name="stretch",
    sentence="the strip stretches under its own weight and the pull of the gripper",
    of="strip",
    stage=Stage.LAW,
    parameters=(Parameter("stiffness", "N", low=0.5, high=1e6, null=None),),
    apply=_apply,
    typical=lambda strip: tuple(strip.weight / strain for strain in (0.002, 0.006, 0.02)),
    textile={"stiffness": Span(6.0, 39.0, log=True)},
    revealed_by="a taut lift and a high carry: the hanging part grows longer",
)
