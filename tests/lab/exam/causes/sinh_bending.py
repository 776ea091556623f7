"""Hidden cause: bending stiffness rising or falling with curvature by a law other than a cubic."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.twin.chain.forces import ForceFunction, Parts, resistance
from drivers.types import Array
from tests.lab.exam.causes.cause import Cause

LINEAR_FROM = 6.0  # curvature in units of k_s from which on the nonlinear moment stays constant


class SinhBending(Cause):
    """Elastic moment M = EI k_s sinh(kappa / k_s), or tanh where `cubic` is negative.

    `cubic` [m^2] is the coefficient of the law's own series: 1 / (6 k_s^2) for sinh and
    -1 / (3 k_s^2) for tanh. Source of the saturating law: friction couples of yarns, Grosberg,
    The mechanical properties of woven fabrics II, Text. Res. J. 36, 1966; sinh is assumed.
    """

    amount: ClassVar[str] = "cubic"
    answers: ClassVar[str | None] = "nonlinear_bending"

    cubic: float = Field(ge=-1e-3, le=1e-3)  # m^2

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Moment added to the elastic one at every hinge; None where it is zero."""
        if self.cubic == 0:
            return None
        hard = self.cubic > 0
        bend = np.sqrt(1.0 / ((6.0 if hard else 3.0) * abs(self.cubic)))
        return resistance(parts, Excess(parts.lumps.stiffness, bend * parts.lumps.reach, hard=hard))


class Excess:
    """Nonlinear part of a sinh or tanh bending law with the angle `scale` (n + 1,) [rad]."""

    def __init__(self, stiffness: Array, scale: Array, *, hard: bool) -> None:
        self._stiffness, self._scale, self._hard = stiffness, scale, hard

    def __call__(self, angle: Array, rate: Array, h: float) -> tuple[Array, Array]:
        """Nonlinear moment (n + 1,) [N m] and its slope [N m/rad] at `angle` (n + 1,) [rad]."""
        x = np.clip(angle / self._scale, -LINEAR_FROM, LINEAR_FROM)
        value = np.sinh(x) if self._hard else np.tanh(x)
        slope = np.cosh(x) if self._hard else 1.0 / np.cosh(x) ** 2
        return self._stiffness * self._scale * (value - x), self._stiffness * (slope - 1.0)


CAUSE = SinhBending
