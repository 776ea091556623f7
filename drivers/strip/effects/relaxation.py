"""Relaxation: part of the rigidity decays over time (a Maxwell element)."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.crease import add_grasp_crease
from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    law = replace(model.mechanics.law, relaxing=values["ratio"], relaxation_time=values["time"])
    lawful = replace(model, mechanics=replace(model.mechanics, law=law))
    return add_grasp_crease(lawful, values["set"])


EFFECT = Effect(
    name="relaxation",
    sentence="the strip slowly gives way while it is held bent",
    of="strip",
    stage=Stage.LAW,
    parameters=(
        Parameter("ratio", "1", low=0.0, high=0.9),
        Parameter("time", "s", low=0.01, high=100.0, null=None, role="time"),
        Parameter("set", "rad", low=0.0, high=3.0, null=None, default=0.0, guess=0.3, role="shape"),
    ),
    apply=_apply,
    typical=lambda _: (0.03, 0.2),
    textile={"ratio": Span(0.03, 0.2), "time": Span(0.1, 2.0, log=True)},
    revealed_by="a fold that stops and holds: the shape goes on sagging",
)
