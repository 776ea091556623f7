"""Nonlinear bending: rigidity that grows or falls with curvature."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    law = replace(model.mechanics.law, cubic=values["cubic"], fifth=values["fifth"])
    return replace(model, mechanics=replace(model.mechanics, law=law))


EFFECT = Effect(
    name="nonlinear_bending",
    sentence="the strip grows stiffer (or softer) the more sharply it is bent",
    of="strip",
    stage=Stage.LAW,
    # Below -5e-6 the moment would fall again at curvatures that a fold reaches (258 1/m).
    parameters=(
        Parameter("cubic", "m^2", low=-5e-6, high=1e-3),
        Parameter(
            "fifth", "1", low=0.0, high=10.0, null=None, default=0.0, guess=0.3, role="shape"
        ),
    ),
    apply=_apply,
    typical=lambda _: (-4e-6, 3e-5, 2e-4),
    textile={"cubic": Span(3e-5, 2e-4, log=True)},
    revealed_by="a slow fold with a low and a high carry: only sharp bends change",
)
