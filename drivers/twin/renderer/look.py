"""Visual appearance of a strip, as the renderer draws it."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from drivers.strip.file import StripFile
from drivers.twin.renderer.looks.look import UNIFORM, Pattern
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class StripLook:
    """Visual appearance of a strip: `colour` (sRGB, 0..255), `thickness` [m] and `width` [m].

    `pattern` is printed on it.
    """

    colour: tuple[int, int, int]
    thickness: float
    width: float
    pattern: Pattern = UNIFORM

    @classmethod
    def of(cls, strip: StripFile, pattern: Pattern = UNIFORM) -> Self:
        """The look that a strip or plant file states, `pattern` printed on it."""
        return cls(strip.colour, strip.thickness, strip.width, pattern)

    def tint(self, s: Array, y: Array) -> Array | None:
        """BGR colours (n, 3) at arc lengths and depths (n,) [m]; None for a strip of one colour."""
        if self.pattern.plain:
            return None
        i, j = (np.floor(place / self.pattern.pitch).astype(np.int64) for place in (s, y))
        colours = self.pattern.colours(self.colour)
        part = {"across": i, "along": j, "checks": i + j}[self.pattern.kind]
        return np.asarray(colours[part % len(colours)])
