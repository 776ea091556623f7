"""Scale error of the positions measured by the calibrated camera."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    observation = replace(model.observation, scale=values["scale"])
    return replace(model, observation=observation)


EFFECT = Effect(
    name="homography_scale",
    sentence="the camera shows lengths too long or too short",
    of="cell",
    stage=Stage.OBSERVATION,
    parameters=(Parameter("scale", "1", low=-0.1, high=0.1),),
    apply=_apply,
    typical=lambda _: (0.0005, 0.005),
    revealed_by="the picture of a board or of two marks a known length apart",
)
