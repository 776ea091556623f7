"""Priors of the rest curvature: none, constant, varying."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from drivers.strip.cantilever import hinges
from drivers.types import Array

KNOT_SPACING = 2.0  # widths: over less no strip changes its set
MOST_KNOTS = 60


class RestCurvature(StrEnum):
    """Kinds of rest curvature: none, constant (a curl), varying along the strip (a set)."""

    STRAIGHT = "straight"
    CURLED = "curled"
    SET = "set"


@dataclass(frozen=True, slots=True)
class RestCurvaturePrior:
    """A kind of rest curvature, and its standard deviation `spread` [1/m] along the strip."""

    kind: RestCurvature
    spread: float = 0.0

    def fields(self, overhang: float, width: float) -> Array:
        """Basis fields (hinges, m) [1/m] of the rest curvature, with standard normal coefficients.

        A curl is one constant field. A set adds one at each knot, independent of the others.
        """
        arc = hinges(overhang)
        if self.kind is RestCurvature.STRAIGHT:
            return np.zeros((len(arc), 0))
        even = np.full((len(arc), 1), self.spread)
        if self.kind is RestCurvature.CURLED:
            return even
        count = int(np.clip(overhang / (KNOT_SPACING * width), 4, MOST_KNOTS)) + 1
        knots = np.linspace(0.0, overhang, count)
        tents = np.stack([np.interp(arc, knots, row) for row in np.eye(count)], axis=1)
        return np.concatenate([even, self.spread * tents], axis=1)


STRAIGHT = RestCurvaturePrior(RestCurvature.STRAIGHT)
