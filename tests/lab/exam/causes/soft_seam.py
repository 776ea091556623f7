"""Hidden cause: a seam whose stiffness fades out smoothly at its edges."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.strip.model import StripModel
from tests.lab.exam.causes.cause import Cause


class SoftSeam(Cause):
    """Rigidity factor 1 + (factor - 1) exp(-(s - position)^2 / (2 sigma^2)) along the strip.

    sigma = width / sqrt(2 pi), so that a seam of the library as wide and as stiff has the same
    integral. Source: assumed; glue and overlocked edges fade out.
    """

    amount: ClassVar[str] = "factor"
    answers: ClassVar[str | None] = "seam"

    factor: float = Field(ge=0.1, le=50)
    position: float = Field(0.3, ge=0, le=2)  # m
    width: float = Field(0.03, ge=0.005, le=0.3)  # m

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model with the rigidity of the seam."""
        if self.factor == 1:
            return model
        mechanics = model.mechanics
        away = (mechanics.cells - self.position) / self.width
        factor = 1.0 + (self.factor - 1.0) * np.exp(-np.pi * away**2)
        return replace(model, mechanics=mechanics.scale_rigidity(factor))


CAUSE = SoftSeam
