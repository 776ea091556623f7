"""Appearance of the strip and of its surroundings, learnt before a fold."""

from dataclasses import dataclass

import numpy as np

from cell.perception.segmenter import Segmenter
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Appearance:
    """Appearance model learnt before a fold: the `scene`, and the `rest` line of the strip in it.

    `rest` (k,) are polynomial coefficients, constant first, of the resting midline's height [m]
    over x [m] as the homography maps it.
    """

    scene: Segmenter
    rest: Array

    def rest_height(self, x: Array) -> Array:
        """Height (n,) [m] of the resting midline at x (n,) [m]."""
        return np.asarray(np.polynomial.polynomial.polyval(x, self.rest))
