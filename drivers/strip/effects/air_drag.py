"""Drag of still air on a strip that moves across itself."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    mechanics = replace(model.mechanics, drag_coefficient=values["coefficient"])
    return replace(model, mechanics=mechanics)


EFFECT = Effect(
    name="air_drag",
    sentence="the air slows the strip down where it moves broadside",
    of="strip",
    stage=Stage.LAW,
    parameters=(Parameter("coefficient", "1", low=0.0, high=10.0),),
    apply=_apply,
    channels=frozenset({"contact_x", "profile", "layer_touch"}),
    revealed_by="a fast fold against a slow one: the falling fold arrives late",
)
