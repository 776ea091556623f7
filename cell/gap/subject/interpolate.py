"""Interpolates a simulated motion between its time steps."""

import numpy as np

from drivers.types import Array


def interpolate(states: Array, t: Array, step: float) -> tuple[Array, Array]:
    """Positions and rates (..., joints, k) at times `t` (k,) [s] between steps of `step` [s].

    `states` (..., steps + 1, 2, joints) are interpolated by cubic Hermite polynomials in position,
    linearly in rate.
    """
    k = np.minimum((t / step).astype(np.int64), states.shape[-3] - 2)
    u = (t / step - k)[:, None]
    a, b = states[..., k, 0, :], states[..., k + 1, 0, :]
    va, vb = step * states[..., k, 1, :], step * states[..., k + 1, 1, :]
    rise = b - a
    q = a + u * (va + u * (3 * rise - 2 * va - vb + u * (va + vb - 2 * rise)))
    return q.swapaxes(-1, -2), ((va + u * (vb - va)) / step).swapaxes(-1, -2)
