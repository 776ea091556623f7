"""Sensor delay: readings are stamped later than they were taken."""

from cell.gap.subject.mechanism.effect import Effect, Readings, single
from cell.gap.subject.mechanism.model import Mechanism
from drivers.types import Array


def _read(mechanism: Mechanism, values: Array, readings: Readings) -> None:
    readings.delay += float(values[0])


EFFECT = Effect(
    name="sensor_delay",
    sentence="readings are stamped late",
    of="rig",
    source="transport delay",
    parameters=lambda m: single("time", "s", 0.1 * m.step),
    read=_read,
    revealed_by="fast motion there and back",
)
