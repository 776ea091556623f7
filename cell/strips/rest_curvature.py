"""How a strip may be born: straight, with a curl, or with a set that differs along it."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from drivers.strip.cantilever import hinges
from drivers.types import Array

KNOT_SPACING = 2.0  # widths: over less no strip changes its set
MOST_KNOTS = 60


class RestCurvature(StrEnum):
    """Kinds of rest curvature."""

    STRAIGHT = "straight"
    CURLED = "curled"
    SET = "set"


@dataclass(frozen=True, slots=True)
class RestCurvaturePrior:
    """A kind of rest curvature, and its standard deviation `spread` [1/m] along the strip."""

    born: RestCurvature
    spread: float = 0.0

    def fields(self, overhang: float, width: float) -> Array:
        """Rest curvatures (hinges, m) [1/m] whose sum it is, each with deviate 1.

        A curl is one even curvature. A set has besides one at each knot, independent of the
        others: how it waves is left to the picture.
        """
        arc = hinges(overhang)
        if self.born is RestCurvature.STRAIGHT:
            return np.zeros((len(arc), 0))
        even = np.full((len(arc), 1), self.spread)
        if self.born is RestCurvature.CURLED:
            return even
        count = int(np.clip(overhang / (KNOT_SPACING * width), 4, MOST_KNOTS)) + 1
        knots = np.linspace(0.0, overhang, count)
        tents = np.stack([np.interp(arc, knots, row) for row in np.eye(count)], axis=1)
        return np.concatenate([even, self.spread * tents], axis=1)


STRAIGHT = RestCurvaturePrior(RestCurvature.STRAIGHT)
