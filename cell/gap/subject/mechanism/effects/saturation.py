"""Torque saturation: a drive gives no more than a largest torque."""

from cell.gap.subject.mechanism.effect import Effect, Fields, driven_joints
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"torque_{j.name}", "N m", 0.0, 0.0, 20.0 / j.torque, step=1e-3 / j.torque,
                  spread=1.0 / j.torque, inverse=True)
        for j in driven_joints(mechanism)
    )  # fmt: skip


def _edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
    for joint, inverse in zip(driven_joints(mechanism), values, strict=True):
        if inverse != 0.0:
            most = 1.0 / inverse
            low, high = fields["actuator_forcerange"][joint.actuator]
            fields["actuator_forcerange"][joint.actuator] = (max(low, -most), min(high, most))


EFFECT = Effect(
    name="saturation",
    sentence="a drive gives no more than a largest torque",
    of="rig",
    source="MJCF actuator/forcerange",
    parameters=_parameters,
    edit=_edit,
    revealed_by="fast starts and stops",
    modes=("forward",),
    probes=(12.5, 25.0, 50.0),
)
