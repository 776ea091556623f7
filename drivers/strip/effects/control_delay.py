"""Control delay: the arm reports each gripper pose later than the gripper reaches it."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    rig = replace(model.rig, delay=values["time"])
    return replace(model, rig=rig)


EFFECT = Effect(
    name="control_delay",
    sentence="the arm reports its positions late",
    of="cell",
    stage=Stage.BOUNDARY,
    parameters=(Parameter("time", "s", low=-0.2, high=0.2),),
    apply=_apply,
    typical=lambda _: (0.003, 0.015),
    looks_like=frozenset({"camera_latency"}),
    revealed_by="an empty-hand run under a second clock; a still image",
)
