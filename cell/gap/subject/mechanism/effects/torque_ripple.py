"""Torque ripple: cogging or gear mesh varies a drive's torque periodically with the angle."""

from typing import Any

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, per_joint
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.subject import Parameter
from drivers.types import Array

ORDER = 6.0  # periods a turn, where nothing says otherwise


def _shape(mechanism: Mechanism) -> tuple[Parameter, ...]:
    orders = [Parameter(f"order_{j.name}", "1", ORDER, 1.0, 200.0, step=0.01, spread=ORDER,
                        shape=True) for j in mechanism.joints]  # fmt: skip
    size = 0.04 * np.ones(len(mechanism.joints))
    phases = per_joint(mechanism, "phase", "rad", size, signed=True, shape=True, high=100.0)
    return (*orders, *phases)


def law(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Ripple torque [N m] of a joint, from floats or columns (m,); its values begin at `p[at]`."""
    return p[at] * np.sin(p[at + 1] * q + p[at + 2])


EFFECT = Effect(
    name="torque_ripple",
    sentence="a drive's torque ripples with its angle",
    of="model",
    source="cogging: Holtz and Springob 1996, IEEE Trans. Ind. Electron. 43",
    parameters=lambda m: per_joint(m, "amplitude", "N m", 0.01 * m.torque),
    shape=_shape,
    keys=3,
    law=law,
    revealed_by="slow turns at a constant rate",
)
