"""Torque constant error: a motor gives more or less torque for its current than stated."""

from cell.gap.subject.mechanism.effect import Effect, Fields, driven_joints, scale_gain
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    for joint, error in zip(driven_joints(mechanism), values, strict=True):
        scale_gain(fields, joint.actuator, 1.0 + error)


EFFECT = Effect(
    name="torque_constant",
    sentence="motors give another torque for their current than stated",
    of="rig",
    source="torque = (1 + error) k i",
    parameters=lambda m: tuple(
        Parameter(f"error_{j.name}", "1", 0.0, -0.9, 3.0, step=1e-5, spread=0.25)
        for j in driven_joints(m)
    ),
    edit=_edit,
    revealed_by="a known weight on the tip",
    error_of="gain",
)
