"""Quadratic damping: a torque that grows with the square of its rate brakes each joint."""

from typing import Any

from cell.gap.subject.mechanism.effect import MODES, Effect, add_to, per_joint
from drivers.types import Array


def law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Damping torque [N m] of a joint, from floats or columns (m,); its values begin at `p[at]`."""
    return -p[at] * abs(v) * v


EFFECT = Effect(
    name="quadratic_damping",
    sentence="joints brake with the square of their rate",
    of="model",
    source="fluid damping at high Reynolds numbers; MJCF joint/damping",
    parameters=lambda m: per_joint(m, "coefficient", "N m s^2", 0.01 * m.torque / m.rate**2),
    keys=1,
    law=law,
    edit=add_to("dof_dampingpoly"),
    modes=MODES,
    revealed_by="fast motion against slow",
)
