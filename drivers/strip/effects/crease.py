"""A crease: a turn that the strip has by birth at one place."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel
from drivers.types import frozen

REACH = 0.005  # m to each side over which a crease turns


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    mechanics = model.mechanics
    away = np.abs(mechanics.cells - values["position"])
    near = mechanics.inside(values["position"], 2 * REACH) * np.clip(1.0 - away / REACH, 0.0, 1.0)
    curvature = values["angle"] * near / mechanics.total(near, mechanics.ends)
    curved = frozen(mechanics.rest_curvature + curvature)
    return replace(model, mechanics=replace(mechanics, rest_curvature=curved))


EFFECT = Effect(
    name="crease",
    sentence="the strip has a crease",
    of="strip",
    stage=Stage.LAW,
    parameters=(
        Parameter("angle", "rad", low=-2.0, high=2.0),
        Parameter("position", "m", low=0.0, high=2.0, null=None),
    ),
    apply=_apply,
    channels=frozenset({"contact_x", "profile", "layer_touch"}),
    revealed_by="slow folds of other heights: a bend stays at one place of the strip",
)
