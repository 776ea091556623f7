"""Offset of the gripper's true pitch from the pitch that the arm reports."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    rig = replace(model.rig, grip_tilt=values["angle"])
    return replace(model, rig=rig)


EFFECT = Effect(
    name="gripper_tilt",
    sentence="the gripper is tilted against what the arm reports",
    of="cell",
    stage=Stage.BOUNDARY,
    parameters=(Parameter("angle", "rad", low=-0.5, high=0.5),),
    apply=_apply,
    typical=lambda _: (0.01, -0.03, 0.05),
    revealed_by="a picture of the gripper; folds with a short hanging part",
)
