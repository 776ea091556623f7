"""Hidden cause: damping that grows with a power of the rate of bending."""

from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from drivers.twin.chain.forces import ForceFunction, Parts
from tests.lab.exam.causes.cause import Cause


class PowerDamping(Cause):
    """Adds a moment EI `coefficient` r^2 (|kappa'| / r)^exponent against the rate kappa'.

    At the rate r it is that of the library's quadratic law. Source: the power law of Ostwald and
    de Waele, here of a dashpot; the exponent is assumed.
    """

    amount: ClassVar[str] = "coefficient"
    answers: ClassVar[str | None] = "quadratic_damping"

    coefficient: float = Field(ge=0, le=1.0)  # m s^2
    exponent: float = Field(1.7, ge=1.2, le=3.0)
    rate: float = Field(60.0, gt=0, le=1000)  # 1/(m s), r

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Nonlinear damping of every hinge; None without damping."""
        if self.coefficient == 0:
            return None
        hinges = parts.joints.hinges
        span = parts.lumps.reach
        # moment = K span c r^2 (|w| / (span r))^p = [K c r (|w| / (span r))^(p - 1)] w
        size = parts.lumps.stiffness * self.coefficient * self.rate

        def act(model: mujoco.MjModel, data: mujoco.MjData, _: float, __: float) -> None:
            part = np.abs(data.qvel[hinges]) / (span * self.rate)
            model.dof_damping[hinges] += size * part ** (self.exponent - 1.0)

        return act


CAUSE = PowerDamping
