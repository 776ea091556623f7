"""How strip, desk and backdrop look in this light, sampled before a fold."""

from dataclasses import dataclass

from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Appearance:
    """Colours (3,) BGR 0 to 255 of strip, desk and backdrop, and where the desk ends.

    `horizon` (2,): the desk's far edge in the image, v = horizon[0] + horizon[1] u [px]. `rest`
    (m, 2): the midline of the strip at rest, x and z [m]: what the homography leaves of z = 0.
    """

    strip: Array
    desk: Array
    backdrop: Array
    horizon: Array
    rest: Array
