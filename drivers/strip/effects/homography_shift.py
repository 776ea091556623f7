"""Constant offset of the positions measured by the calibrated camera."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    observation = replace(model.observation, shift_x=values["x"], shift_z=values["z"])
    return replace(model, observation=observation)


EFFECT = Effect(
    name="homography_shift",
    sentence="the camera shows every place off by the same shift",
    of="cell",
    stage=Stage.OBSERVATION,
    parameters=(
        Parameter("x", "m", low=-0.05, high=0.05),
        Parameter("z", "m", low=-0.05, high=0.05),
    ),
    apply=_apply,
    typical=lambda _: (0.0003, 0.003),
    looks_like=frozenset({"contact_bias"}),
    revealed_by="the picture of a mark at a known place, or of the gripper at rest",
)
