"""Rotor inertia of a drive, as its joint feels it behind the gear."""

from cell.gap.subject.mechanism.effect import Effect, Fields, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    return per_joint(mechanism, "inertia", "kg m^2", 0.01 * mechanism.inertia, signed=False)


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    for joint, value in zip(mechanism.joints, values, strict=True):
        if value != 0.0:
            fields["dof_armature"][joint.dof] += value


EFFECT = Effect(
    name="armature",
    sentence="drives have rotor inertia that the model lacks",
    of="model",
    source="MJCF joint/armature: rotor inertia times the gear ratio squared",
    parameters=_parameters,
    edit=_edit,
    revealed_by="fast starts and stops",
)
