"""Drag of still air on a strip that moves across itself."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import Drag, StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    return replace(model, mechanics=replace(model.mechanics, drag=Drag(**values)))


EFFECT = Effect(
    name="air_drag",
    sentence="the air slows the strip down where it moves broadside",
    of="strip",
    stage=Stage.LAW,
    parameters=(
        Parameter("coefficient", "1", low=0.0, high=10.0),
        Parameter("slow", "m/s", low=0.0, high=1.0, null=None, default=0.0, finer=0.03),
        Parameter("oblique", "1", low=0.0, high=1.0, null=None, default=0.0, finer=0.3),
        Parameter("along", "1", low=0.0, high=1.0, null=None, default=0.0, finer=0.1),
    ),
    apply=_apply,
    channels=frozenset({"contact_x", "profile", "layer_touch"}),
    revealed_by="a fast fold against a slow one: the falling fold arrives late",
)
