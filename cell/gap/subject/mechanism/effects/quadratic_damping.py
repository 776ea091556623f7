"""Damping of joints with the square of their rate."""

from typing import Any

from cell.gap.subject.mechanism.effect import MODES, Effect, add_to, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array


def _parameters(mechanism: Mechanism) -> tuple[Parameter, ...]:
    size = 0.01 * mechanism.torque / mechanism.rate**2
    return per_joint(mechanism, "coefficient", "N m s^2", size)


def law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of one joint, of floats or columns (m,); its parameters start at `p[at]`."""
    return -p[at] * abs(v) * v


EFFECT = Effect(
    name="quadratic_damping",
    sentence="joints brake with the square of their rate",
    of="model",
    source="fluid damping at high Reynolds numbers; MJCF joint/damping",
    parameters=_parameters,
    keys=1,
    law=law,
    edit=add_to("dof_dampingpoly"),
    modes=MODES,
    revealed_by="fast motion against slow",
)
