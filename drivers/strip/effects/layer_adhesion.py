"""Adhesion between the layers of a folded strip where they touch."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    mechanics = replace(model.mechanics, adhesion=values["force"])
    return replace(model, mechanics=mechanics)


EFFECT = Effect(
    name="layer_adhesion",
    sentence="the layers cling to each other where they touch",
    of="strip",
    stage=Stage.LAW,
    parameters=(Parameter("force", "N/m", low=0.0, high=50.0),),
    apply=_apply,
    revealed_by="a run that goes on or comes back after the layers have touched",
)
