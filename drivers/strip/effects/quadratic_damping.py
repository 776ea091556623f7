"""Quadratic damping: a bending moment in proportion to the square of the curvature rate."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    law = replace(model.mechanics.law, quadratic_damping=values["coefficient"])
    return replace(model, mechanics=replace(model.mechanics, law=law))


EFFECT = Effect(
    name="quadratic_damping",
    sentence="the strip resists quick bending more than in proportion",
    of="strip",
    stage=Stage.LAW,
    parameters=(Parameter("coefficient", "m s^2", low=0.0, high=0.02),),
    apply=_apply,
    typical=lambda _: (1e-4, 1e-3),
    textile={"coefficient": Span(1e-4, 1e-3, log=True)},
    revealed_by="a fast fold against a slow one, and a shake: only quick bending changes",
)
