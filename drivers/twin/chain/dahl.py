"""Friction that sets in gradually, without a yield point, at the hinges of a chain."""

import numpy as np

from drivers.types import Array


class DahlFriction:
    """Moment law of Dahl elements, each with its `limit` [N m] and `stiffness` [N m/rad].

    dM/dangle = stiffness (1 - s M / limit)^exponent, where s is the sign of the rate. Source: Dahl,
    Solid friction damping of mechanical vibrations, AIAA Journal 14(12), 1976.
    """

    def __init__(self, limit: Array, stiffness: Array, exponent: float) -> None:
        self._limit, self._stiffness, self._exponent = limit, stiffness, exponent
        self._moment = 0.0 * limit
        self._angle = 0.0 * limit

    def __call__(self, angle: Array, rate: Array, h: float) -> tuple[Array, Array]:  # noqa: ARG002
        """Moments [N m] and slopes [N m/rad] at `angle` [rad]; exact for turns in one direction."""
        turn = angle - self._angle
        sign = np.where(turn < 0, -1.0, 1.0)
        reserve = 1.0 - sign * self._moment / self._limit  # 0 in full sliding, 2 at a reversal
        travel = self._stiffness * np.abs(turn) / self._limit
        self._moment = sign * self._limit * (1.0 - _decay(reserve, travel, self._exponent))
        self._angle = angle
        ahead = np.where(rate < 0, -1.0, 1.0)  # direction in which the hinge turns next
        reserve = np.clip(1.0 - ahead * self._moment / self._limit, 0.0, 2.0)
        return self._moment, self._stiffness * reserve**self._exponent


def _decay(start: Array, x: Array, exponent: float) -> Array:
    """Solution u of du/dx = -u^exponent at `x`, from u = `start` at 0."""
    start = np.maximum(start, 1e-12)  # a power below would divide by zero
    if exponent == 1:
        return np.asarray(start * np.exp(-x))
    power = exponent - 1.0
    return np.asarray((start**-power + power * x) ** (-1.0 / power))
