"""A strip that hangs over a ledge under its weight, solved by collocation."""

import numpy as np
from scipy.integrate import solve_bvp

from drivers.base.types import Array


def heavy_elastica(
    arc: Array, bending_length: float, curvature: float = 0.0, clamp: float = 0.0
) -> Array:
    """Points (n, 2) at arc lengths `arc` (n,), of c^3 theta'' = (L - s) cos(theta).

    It leaves the ledge at the angle `clamp` [rad], and is free at its end, where its
    `curvature` [1/m] is that at rest.
    """
    length = arc[-1]

    def slope(s: Array, y: Array) -> Array:
        bend = (length - s) * np.cos(y[0]) / bending_length**3
        return np.array([y[1], bend, np.cos(y[0]), np.sin(y[0])])

    def ends(a: Array, b: Array) -> Array:
        return np.array([a[0] - clamp, b[1] - curvature, a[2], a[3]])

    decay = np.exp(-arc / bending_length)
    angle = clamp - 1 + decay
    start = [angle, -decay / bending_length, arc * np.cos(angle), arc * np.sin(angle)]
    found = solve_bvp(slope, ends, arc, np.array(start), tol=1e-8, max_nodes=100_000)
    assert found.success
    return np.array(found.sol(arc)[2:].T)
