"""Colours of strip, desk and backdrop in the present light."""

from dataclasses import dataclass

import numpy as np

from calibration.perception.scenery import Scenery
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Appearance:
    """Colours (3,) BGR 0 to 255 of strip, desk and backdrop, sampled before a fold.

    `rest` (k,) are polynomial coefficients, constant first, of the resting midline's height [m]
    over x [m] as the homography maps it. `scenery` is the learnt scene where three colours are not
    enough, None where they are.
    """

    strip: Array
    desk: Array
    backdrop: Array
    rest: Array
    scenery: Scenery | None = None

    def rest_height(self, x: Array) -> Array:
        """Height (n,) [m] of the resting midline at x (n,) [m]."""
        return np.asarray(np.polynomial.polynomial.polyval(x, self.rest))
