"""Tool centre point (TCP) error: offset of the true grip point from the reported one."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    rig = replace(model.rig, grip_x=values["x"], grip_z=values["z"])
    return replace(model, rig=rig)


EFFECT = Effect(
    name="tcp_offset",
    sentence="the strip is held beside the point that the arm reports",
    of="cell",
    stage=Stage.BOUNDARY,
    parameters=(
        Parameter("x", "m", low=-0.03, high=0.03),
        Parameter("z", "m", low=-0.03, high=0.03),
    ),
    apply=_apply,
    typical=lambda _: (0.0003, -0.002, 0.003),  # taut on one side, slack on the other
    revealed_by="a picture of the grip; slow folds of other heights",
)
