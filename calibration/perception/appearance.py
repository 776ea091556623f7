"""How strip, desk and backdrop look in this light."""

from dataclasses import dataclass

import numpy as np

from calibration.perception.scenery import Scenery
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Appearance:
    """Colours (3,) BGR 0 to 255 of strip, desk and backdrop, sampled before a fold.

    `rest` (k,) are coefficients, constant first, of the height [m] over x [m] at which the
    homography sees the strip's midline lie at rest. `scenery` is what was learnt where three
    colours are not enough, None where they are.
    """

    strip: Array
    desk: Array
    backdrop: Array
    rest: Array
    scenery: Scenery | None = None

    def rest_height(self, x: Array) -> Array:
        """Height (n,) [m] of the resting midline at x (n,) [m]."""
        return np.asarray(np.polynomial.polynomial.polyval(x, self.rest))
