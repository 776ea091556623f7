"""Pivot compliance: the pivot of a swinging chain gives way sideways under its pull."""

from cell.gap.subject.mechanism.effect import Effect, Fields, single
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    fields["chain.compliance"][...] += values[0]


EFFECT = Effect(
    name="pivot_compliance",
    sentence="the pivot gives way sideways",
    of="rig",
    source="a stiff spring without mass: it follows the chain's pull at once",
    parameters=lambda _: single("compliance", "m/N", 1e-5, high=100.0),
    edit=_edit,
    modes=("planar",),
    revealed_by="press the frame while it swings",
)
