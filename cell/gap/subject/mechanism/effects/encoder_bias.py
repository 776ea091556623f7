"""An encoder that reads a constant too much or too little."""

from cell.gap.subject.mechanism.effect import MODES, Effect, Readings
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _read(mechanism: Mechanism, values: Array, readings: Readings) -> None:
    for name, value in zip(mechanism.encoders, values, strict=True):
        readings.bias[name] = float(value)


EFFECT = Effect(
    name="encoder_bias",
    sentence="encoders read a constant too much or too little",
    of="rig",
    source="zero of an encoder",
    parameters=lambda m: tuple(
        Parameter(f"bias_{name}", "rad", 0.0, -0.2, 0.2, 1e-5, 0.03) for name in m.encoders
    ),
    read=_read,
    modes=MODES,
    revealed_by="hold still in several poses",
)
