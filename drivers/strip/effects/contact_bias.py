"""Bias of the measured desk contact, the place where the strip leaves the desk."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    observation = replace(model.observation, contact_bias=values["bias"])
    return replace(model, observation=observation)


EFFECT = Effect(
    name="contact_bias",
    sentence="the camera sees the place where the strip leaves the desk too far out or in",
    of="cell",
    stage=Stage.OBSERVATION,
    parameters=(Parameter("bias", "m", low=-0.05, high=0.05),),
    apply=_apply,
    typical=lambda _: (0.001, 0.005),
    looks_like=frozenset({"homography_shift"}),
    revealed_by="a strip lifted by hand to a known place",
)
