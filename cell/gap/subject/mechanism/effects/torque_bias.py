"""Torque bias: a drive adds a constant torque, or its torque sensor has an offset."""

from typing import Any

from cell.gap.subject.mechanism.effect import Effect, per_joint
from drivers.types import Array


def law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Constant torque [N m] of a joint, of floats or columns (m,); its values begin at `p[at]`."""
    return p[at] + 0.0 * q


EFFECT = Effect(
    name="torque_bias",
    sentence="a drive adds a constant torque, or its sensor reads one",
    of="rig",
    source="offset of a current sensor",
    parameters=lambda m: per_joint(m, "torque", "N m", 0.01 * m.torque, signed=True),
    keys=1,
    law=law,
    revealed_by="hold still in several poses",
)
