"""Readings that are stamped later than the world was so."""

from cell.gap.subject.mechanism.effect import Effect, Readings, single
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    return single("time", "s", 0.1 * mechanism.step)


def _read(mechanism: Mechanism, values: Array, readings: Readings) -> None:
    readings.delay += float(values[0])


EFFECT = Effect(
    name="sensor_delay",
    sentence="readings are stamped late",
    of="rig",
    source="transport delay",
    parameters=_parameters,
    read=_read,
    revealed_by="fast motion there and back",
)
