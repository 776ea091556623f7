"""Seam: a section of the strip that is stiffer or softer than the rest."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import PLACE_SPAN, Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    mechanics = model.mechanics
    covered = mechanics.inside(values["position"], values["width"], values["softness"])
    factor = (1.0 - covered) + covered * values["factor"]
    return replace(model, mechanics=mechanics.scale_rigidity(factor))


EFFECT = Effect(
    name="seam",
    sentence="the strip has a seam, a piece of other stiffness",
    of="strip",
    stage=Stage.LAW,
    parameters=(
        Parameter("factor", "1", low=0.1, high=50.0, null=1.0),
        Parameter("position", "m", low=0.0, high=2.0, null=None, role="place"),
        Parameter("width", "m", low=0.001, high=0.5, null=None, role="width"),
        Parameter(
            "softness", "1", low=0.0, high=2.0, null=None, default=0.0, guess=0.4, role="shape"
        ),
    ),
    apply=_apply,
    typical=lambda _: (1.8,),
    textile={"position": PLACE_SPAN, "factor": Span(1.5, 5.0), "width": Span(0.01, 0.01)},
    revealed_by="slow folds of other heights: the shape changes where the seam passes the bend",
)
