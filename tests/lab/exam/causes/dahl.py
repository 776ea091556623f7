"""Hidden cause: friction between yarns that sets in gradually, without a yield point."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.twin.chain.forces import DahlFriction, ForceFunction, Parts, resistance
from tests.lab.exam.causes.cause import Cause


class Dahl(Cause):
    """Dahl's friction in addition to the elastic moment, in place of elasto-plastic elements.

    The friction moment M obeys dM/dkappa = ratio EI (1 - s M / M_c)^exponent, where s is the sign
    of the curvature's rate and M_c = `yield_curvature` EI. Source: Dahl, Solid friction damping
    of mechanical vibrations, AIAA Journal 14(12), 1976; `exponent` is his i.
    """

    amount: ClassVar[str] = "yield_curvature"
    answers: ClassVar[str | None] = "bending_hysteresis"

    yield_curvature: float = Field(ge=0, le=100)  # 1/m
    ratio: float = Field(8.0, ge=1, le=50)  # of pre-sliding over bending stiffness
    exponent: float = Field(1.5, ge=1.0, le=3.0)

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Friction moment of every hinge, zero at the start; None without friction."""
        if self.yield_curvature == 0:
            return None
        stiffness = parts.lumps.stiffness
        element = DahlFriction(
            stiffness * self.yield_curvature * parts.lumps.reach,
            self.ratio * stiffness,
            self.exponent,
        )
        return resistance(parts, element)


CAUSE = Dahl
