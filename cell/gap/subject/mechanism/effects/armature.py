"""Rotor inertia of a drive, as its joint feels it behind the gear."""

from cell.gap.subject.mechanism.effect import Effect, Fields, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    for joint, value in zip(mechanism.joints, values, strict=True):
        if value != 0.0:
            fields["dof_armature"][joint.dof] += value


EFFECT = Effect(
    name="armature",
    sentence="drives have rotor inertia that the model lacks",
    of="model",
    source="MJCF joint/armature: rotor inertia times the gear ratio squared",
    parameters=lambda m: per_joint(m, "inertia", "kg m^2", 0.01 * m.inertia, signed=False),
    edit=_edit,
    revealed_by="fast starts and stops",
    error_of="armature",
)
