"""Hidden cause: stiffness that rises along the strip in an S-curve instead of a straight line."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.strip.model import StripModel
from tests.lab.exam.causes.cause import Cause


class SmoothGradient(Cause):
    """Rigidity factor 1 + slope / 2 sin(pi (s / L - 1/2)), at both ends that of a linear gradient.

    Source: assumed; finishes and dyes vary like that from selvedge to middle.
    """

    amount: ClassVar[str] = "slope"
    answers: ClassVar[str | None] = "stiffness_gradient"

    slope: float = Field(gt=-2, lt=2)

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model with the S-shaped profile of rigidity."""
        if self.slope == 0:
            return model
        mechanics = model.mechanics
        share = mechanics.cells / mechanics.length - 0.5
        factor = 1.0 + 0.5 * self.slope * np.sin(np.pi * share)
        return replace(model, mechanics=mechanics.scale_rigidity(factor))


CAUSE = SmoothGradient
