"""An encoder that counts too many or too few steps a turn."""

from cell.gap.subject.mechanism.effect import Effect, Readings
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _read(mechanism: Mechanism, values: Array, readings: Readings) -> None:
    for name, value in zip(mechanism.encoders, values, strict=True):
        readings.scale[name] = float(value)


EFFECT = Effect(
    name="encoder_scale",
    sentence="encoders count too much or too little a turn",
    of="rig",
    source="scale of an encoder",
    parameters=lambda m: tuple(
        Parameter(f"scale_{name}", "1", 0.0, -0.2, 0.2, 1e-5, 0.02) for name in m.encoders
    ),
    read=_read,
    revealed_by="large motion to both stops",
)
