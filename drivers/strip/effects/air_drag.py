"""Drag of still air on the moving strip, mainly across its surface."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
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
        Parameter(
            "slow", "m/s", low=0.0, high=1.0, null=None, default=0.0, guess=0.03, role="shape"
        ),
        Parameter(
            "oblique", "1", low=0.0, high=1.0, null=None, default=0.0, guess=0.3, role="shape"
        ),
        Parameter("along", "1", low=0.0, high=1.0, null=None, default=0.0, guess=0.1, role="shape"),
    ),
    apply=_apply,
    typical=lambda _: (0.3, 1.5),
    textile={"coefficient": Span(0.3, 1.5)},
    revealed_by="a fast fold against a slow one: the falling fold arrives late",
)
