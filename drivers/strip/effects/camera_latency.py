"""Camera latency: images show the world earlier than their stamps."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    observation = replace(model.observation, camera_latency=values["time"])
    return replace(model, observation=observation)


EFFECT = Effect(
    name="camera_latency",
    sentence="the camera shows the world later than its time stamps say",
    of="cell",
    stage=Stage.OBSERVATION,
    parameters=(Parameter("time", "s", low=-0.2, high=0.2),),
    apply=_apply,
    typical=lambda _: (0.003, 0.015),
    looks_like=frozenset({"control_delay"}),
    revealed_by="a fast fold against a slow one: the shift grows with speed",
)
