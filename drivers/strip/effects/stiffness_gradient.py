"""Gradient of bending rigidity from the fixed to the grasped edge, linear or steeper between."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    mechanics = model.mechanics
    away = mechanics.cells / mechanics.length - 0.5
    rise = away * (1.0 + values["central"] * (1.0 - 4.0 * away**2))
    factor = 1.0 + values["slope"] * rise
    return replace(model, mechanics=mechanics.scale_rigidity(factor))


EFFECT = Effect(
    name="stiffness_gradient",
    sentence="the strip is stiffer towards one of its ends",
    of="strip",
    stage=Stage.LAW,
    parameters=(
        Parameter("slope", "1", low=-1.8, high=1.8),
        Parameter(
            "central", "1", low=0.0, high=1.0, null=None, default=0.0, guess=0.3, role="shape"
        ),
    ),
    apply=_apply,
    typical=lambda _: (0.2, 0.8),
    textile={"slope": Span(-0.8, 0.8)},
    revealed_by="the strip with its ends swapped, and folds of other heights",
)
