"""Command delay: commands take effect later than their time stamps state."""

from cell.gap.subject.mechanism.effect import Effect, Readings, single
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    forward = mechanism.mode == "forward" and bool(mechanism.actuators)
    if not (forward or mechanism.trackings):
        return ()
    return single("time", "s", 0.1 * mechanism.step)


def _read(mechanism: Mechanism, values: Array, readings: Readings) -> None:
    readings.command += float(values[0])


EFFECT = Effect(
    name="control_delay",
    sentence="commands take effect late",
    of="rig",
    source="transport delay",
    parameters=_parameters,
    read=_read,
    revealed_by="fast starts and stops",
)
