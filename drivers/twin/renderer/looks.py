"""Appearances of the simulated cell: surroundings, light, and patterns printed on the
strip.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import numpy as np

from drivers.base.readers import read_yaml
from drivers.base.settings import Settings, parse
from drivers.base.types import Array
from drivers.strip.file import StripFile

Colour = tuple[int, int, int]
Point = tuple[float, float, float]


class Box(Settings):
    """Box parallel to the axes of the cell frame: low and high corner [m], sRGB
    colour.
    """

    low: Point
    high: Point
    colour: Colour


class Cable(Settings):
    """Cable through `points` [m] of the cell frame, `thickness` [m] across, of an sRGB
    colour.
    """

    points: tuple[Point, ...]
    thickness: float
    colour: Colour


Thing = Box | Cable


class Lamp(Settings):
    """Lamp at `position` [m] in the cell frame that casts the arm's shadow; `size` [m]
    is its radius.

    `share` is its fraction of the light at the desk.
    """

    position: Point
    size: float
    share: float


class Flicker(Settings):
    """Flickering light, which dims by the fraction `depth` twice per period of the
    `mains` [Hz].

    A rolling shutter reads the image from top to bottom in `readout` [s].
    """

    mains: float
    depth: float
    readout: float


class Pattern(Settings):
    """Pattern printed on a strip: the colours `printed` alternate with the strip's own
    every `pitch` [m].

    `across` alternates along the strip's length, `along` over its width, `checks` in
    both. `brightness` scales that of the strip's colour.
    """

    kind: Literal["across", "along", "checks"] = "across"
    pitch: float = 0.02
    printed: tuple[Colour, ...] = ()
    brightness: float = 1.0

    @property
    def plain(self) -> bool:
        """Whether the strip has only the colour that its file states."""
        return not self.printed and self.brightness == 1.0

    def colours(self, stated: Colour) -> Array:
        """BGR colours of the pattern, one row (3,) each; first the strip's own colour,
        `stated` in sRGB.
        """
        plain_colour = np.array(stated, dtype=np.float64) * self.brightness
        return np.array([plain_colour, *self.printed], dtype=np.float64)[:, ::-1]


UNIFORM = Pattern()


class Look(Settings):
    """Visual appearance of the cell, as differences from the plain green cell.

    `colours` are sRGB by key of the twin's surroundings; `things` are static objects
    around the strip.
    """

    colours: Mapping[str, Colour] = {}
    things: tuple[Thing, ...] = ()
    lamp: Lamp | None = None
    flicker: Flicker | None = None
    pattern: Pattern = UNIFORM


@dataclass(frozen=True, slots=True)
class StripLook:
    """Visual appearance of a strip: `colour` (sRGB, 0..255), `thickness` [m] and
    `width` [m].

    `pattern` is printed on it.
    """

    colour: tuple[int, int, int]
    thickness: float
    width: float
    pattern: Pattern = UNIFORM

    @classmethod
    def from_file(cls, strip: StripFile, pattern: Pattern = UNIFORM) -> Self:
        """Appearance that a strip or plant file states, with `pattern` printed on the
        strip.
        """
        return cls(strip.colour, strip.thickness, strip.width, pattern)

    def tint(self, s: Array, y: Array) -> Array | None:
        """BGR colours (n, 3) of points at arc lengths `s` and depths `y` (n,) [m]; None
        for a strip of a single colour.
        """
        pattern = self.pattern
        if pattern.plain:
            return None
        i, j = (
            np.floor(coordinate / pattern.pitch).astype(np.int64)
            for coordinate in (s, y)
        )
        colours = pattern.colours(self.colour)
        part = {"across": i, "along": j, "checks": i + j}[pattern.kind]
        tint: Array = colours[part % len(colours)]
        return tint


DEFAULT_LOOK = "green-mat"
PLAIN = Look()
STATED = read_yaml(Path(__file__).with_suffix(".yaml"))
LOOKS: Mapping[str, Look] = {
    DEFAULT_LOOK: PLAIN,
    **{name: parse(look, Look, name) for name, look in STATED.items()},
}


def check_look(name: str) -> str:
    """Return `name` if it names a look of the simulated cell; raises ValueError with
    all allowed names otherwise.
    """
    if name not in LOOKS:
        raise ValueError(f"there is no look {name!r}; allowed: {', '.join(LOOKS)}")
    return name
