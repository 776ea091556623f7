"""Hidden cause: air humidity that differs from run to run."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.strip.model import StripModel
from tests.lab.exam.causes.cause import Cause, Sizes


class Humidity(Cause):
    """Multiplies the rigidity by exp(spread g), with a new standard normal g in each run.

    The retardation time falls with its square root. Source: the bending modulus of cotton falls by
    some 2 % for each per cent of relative humidity (Morton and Hearle, Physical Properties of
    Textile Fibres); the rest is assumed.
    """

    amount: ClassVar[str] = "spread"
    sizes: ClassVar[Sizes] = {"medium": {"spread": 0.45}, "strong": {"spread": 0.8}}

    spread: float = Field(ge=0, le=1)

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model with the rigidity and retardation time of this run's humidity."""
        if self.spread == 0:
            return model
        factor = float(np.exp(self.spread * rng.standard_normal()))
        mechanics = model.mechanics.scale_rigidity(np.full(len(model.mechanics.rigidity), factor))
        viscosity = mechanics.viscosity / np.sqrt(factor)
        return replace(model, mechanics=replace(mechanics, viscosity=viscosity))


CAUSE = Humidity
