"""Hidden cause: a sudden loss of stiffness between two runs."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.strip.model import StripModel
from tests.lab.exam.causes.cause import Cause, Sizes


class BrokenIn(Cause):
    """Multiplies the rigidity by `factor` from run `first` on; the retardation time stays.

    Source: assumed; a size or finish that cracks when it is first bent sharply.
    """

    amount: ClassVar[str] = "factor"
    sizes: ClassVar[Sizes] = {"medium": {"factor": 0.45}, "strong": {"factor": 0.3}}

    factor: float = Field(gt=0.05, le=5)
    first: int = Field(5, ge=1, le=100)

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model of this run, its rigidity multiplied by `factor` from run `first` on."""
        if self.factor == 1 or model.index < self.first:
            return model
        same = np.full(len(model.mechanics.rigidity), self.factor)
        return replace(model, mechanics=model.mechanics.scale_rigidity(same))


CAUSE = BrokenIn
