"""What a strip looks like."""

from dataclasses import dataclass
from typing import Self

from drivers.strip.file import StripFile


@dataclass(frozen=True, slots=True)
class StripLook:
    """`colour` (sRGB, 0..255), `thickness` [m] and `width` [m] of the strip on the desk."""

    colour: tuple[int, int, int]
    thickness: float
    width: float

    @classmethod
    def of(cls, strip: StripFile) -> Self:
        """The look that a strip or plant file states."""
        return cls(strip.colour, strip.thickness, strip.width)
