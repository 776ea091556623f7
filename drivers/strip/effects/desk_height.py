"""Desk height error: the desk is higher or lower than the arm assumes."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    rig = replace(model.rig, desk_height=values["height"])
    return replace(model, rig=rig)


EFFECT = Effect(
    name="desk_height",
    sentence="the desk is not at the height that the arm assumes",
    of="cell",
    stage=Stage.BOUNDARY,
    parameters=(Parameter("height", "m", low=-0.02, high=0.02),),
    apply=_apply,
    typical=lambda _: (0.0005, -0.002, 0.003),
    revealed_by="the desk touched again with the gripper; folds of other heights",
)
