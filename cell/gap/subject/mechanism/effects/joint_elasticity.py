"""Joint elasticity: the gear between motor and link twists like a spring."""

from cell.gap.subject.mechanism.effect import Effect, Readings, has_gears, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    if not has_gears(mechanism):
        return ()
    rate = 30.0 * mechanism.rate
    return per_joint(mechanism, "compliance", "rad/(N m)", 0.01 / (mechanism.inertia * rate**2))


def _read(mechanism: Mechanism, values: Array, readings: Readings) -> None:
    readings.elastic = values


EFFECT = Effect(
    name="joint_elasticity",
    sentence="gears twist: links spring on their motors",
    of="model",
    source="Spong 1987, J. Dyn. Sys. Meas. Control 109",
    parameters=_parameters,
    read=_read,
    revealed_by="fast starts and stops: the link rings on",
)
