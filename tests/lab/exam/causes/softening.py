"""Hidden cause: internal damping that a specimen loses in its first runs."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.strip.model import StripModel
from drivers.types import frozen
from tests.lab.exam.causes.cause import Cause


class Softening(Cause):
    """Multiplies the retardation time by 1 - loss (1 - exp(-index / runs)); the rigidity stays.

    Source: assumed; handle tests of fabrics are conditioned by repeated bending for this reason.
    """

    amount: ClassVar[str] = "loss"

    loss: float = Field(ge=0, lt=1)
    runs: float = Field(2.5, gt=0, le=100)

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model with the damping that is left after its earlier runs."""
        if self.loss == 0:
            return model
        factor = 1.0 - self.loss * (1.0 - np.exp(-model.index / self.runs))
        viscosity = frozen(model.mechanics.viscosity * factor)
        return replace(model, mechanics=replace(model.mechanics, viscosity=viscosity))


CAUSE = Softening
