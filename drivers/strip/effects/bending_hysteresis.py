"""Bending hysteresis: dry friction between yarns, with a yield point or setting in gradually."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.crease import add_grasp_crease
from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    law = replace(
        model.mechanics.law,
        yield_curvature=values["yield_curvature"],
        stiffness_ratio=values["stiffness_ratio"],
        gradual=values["gradual"],
    )
    lawful = replace(model, mechanics=replace(model.mechanics, law=law))
    return add_grasp_crease(lawful, values["set"])


EFFECT = Effect(
    name="bending_hysteresis",
    sentence="the strip resists bending like dry friction",
    of="strip",
    stage=Stage.LAW,
    parameters=(
        Parameter("yield_curvature", "1/m", low=0.0, high=100.0),
        Parameter(
            "stiffness_ratio", "1", low=1.0, high=100.0, null=None, default=8.0, role="ratio"
        ),
        Parameter("set", "rad", low=0.0, high=3.0, null=None, default=0.0, guess=0.3, role="shape"),
        Parameter(
            "gradual", "1", low=0.0, high=1.0, null=None, default=0.0, guess=0.3, role="shape"
        ),
    ),
    apply=_apply,
    typical=lambda _: (1.0, 5.0, 20.0),
    textile={
        "yield_curvature": Span(2.0, 60.0, log=True),  # KES tables hold 20 to 60
        "stiffness_ratio": Span(5.0, 12.0),
    },
    revealed_by="a slow fold there and back: the shapes on the two ways differ at the same place",
)
