"""A look of the cell: what surrounds the strip, how it is lit, and what is printed on the strip."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drivers.types import Array

Colour = tuple[int, int, int]
Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Box:
    """A box parallel to the axes of the cell frame: low and high corner [m], its sRGB colour."""

    low: Point
    high: Point
    colour: Colour


@dataclass(frozen=True, slots=True)
class Cable:
    """A cable through `points` [m], `thickness` [m] across, of one sRGB colour."""

    points: tuple[Point, ...]
    thickness: float
    colour: Colour


Thing = Box | Cable


@dataclass(frozen=True, slots=True)
class Lamp:
    """A lamp at `place` [m] that casts the arm's shadow; `size` [m] is its radius.

    `share` is its fraction of the light at the desk.
    """

    place: Point
    size: float
    share: float


@dataclass(frozen=True, slots=True)
class Flicker:
    """Flickering light: it dims by the share `depth` twice per period of the `mains` [Hz].

    A rolling shutter reads the image from top to bottom in `readout` [s].
    """

    mains: float
    depth: float
    readout: float


@dataclass(frozen=True, slots=True)
class Pattern:
    """Printed pattern: colours that alternate with the strip's own every `pitch` [m].

    `across` alternates along the strip's length, `along` over its width, `checks` in both.
    `own` scales the brightness of the strip's own colour.
    """

    kind: Literal["across", "along", "checks"] = "across"
    pitch: float = 0.02
    others: tuple[Colour, ...] = ()
    own: float = 1.0

    @property
    def plain(self) -> bool:
        """Whether the strip keeps the one colour that its file states."""
        return not self.others and self.own == 1.0

    def colours(self, stated: Colour) -> Array:
        """BGR colours (k, 3) of the pattern, the strip's own first."""
        own = np.array(stated, dtype=np.float64) * self.own
        return np.array([own, *self.others], dtype=np.float64)[:, ::-1]


UNIFORM = Pattern()


@dataclass(frozen=True, slots=True)
class Look:
    """Visual appearance of the cell, as differences from the plain green cell.

    `says` describes it to the operator; `colours` are sRGB by key of the twin's surroundings;
    `things` are static objects around the strip.
    """

    name: str
    says: str
    colours: Mapping[str, Colour] = field(default_factory=dict)
    things: tuple[Thing, ...] = ()
    lamp: Lamp | None = None
    flicker: Flicker | None = None
    pattern: Pattern = UNIFORM
