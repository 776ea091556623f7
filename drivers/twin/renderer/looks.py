"""Appearances of the simulated cell: surroundings, light, and patterns printed on the
strip.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Self

import numpy as np

from drivers.base.types import Array
from drivers.strip.file import StripFile

Colour = tuple[int, int, int]
Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Box:
    """Box parallel to the axes of the cell frame: low and high corner [m], sRGB
    colour.
    """

    low: Point
    high: Point
    colour: Colour


@dataclass(frozen=True, slots=True)
class Cable:
    """Cable through `points` [m] of the cell frame, `thickness` [m] across, of an sRGB
    colour.
    """

    points: tuple[Point, ...]
    thickness: float
    colour: Colour


Thing = Box | Cable


@dataclass(frozen=True, slots=True)
class Lamp:
    """Lamp at `position` [m] in the cell frame that casts the arm's shadow; `size` [m]
    is its radius.

    `share` is its fraction of the light at the desk.
    """

    position: Point
    size: float
    share: float


@dataclass(frozen=True, slots=True)
class Flicker:
    """Flickering light, which dims by the fraction `depth` twice per period of the
    `mains` [Hz].

    A rolling shutter reads the image from top to bottom in `readout` [s].
    """

    mains: float
    depth: float
    readout: float


@dataclass(frozen=True, slots=True)
class Pattern:
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


@dataclass(frozen=True, slots=True)
class Look:
    """Visual appearance of the cell, as differences from the plain green cell.

    `colours` are sRGB by key of the twin's surroundings; `things` are static objects
    around the strip.
    """

    colours: Mapping[str, Colour] = field(default_factory=dict)
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


THINGS: tuple[Thing, ...] = (
    Box((-0.55, 1.05, 0.30), (0.40, 1.15, 0.33), (150, 128, 98)),  # a shelf on the wall
    Box((-0.30, 1.02, 0.33), (-0.16, 1.10, 0.52), (196, 150, 60)),  # a folder on it
    Box((-0.14, 1.02, 0.33), (-0.05, 1.10, 0.48), (150, 190, 205)),
    # a carton behind the desk
    Box((0.55, 0.75, 0.00), (1.05, 0.95, 0.34), (190, 160, 118)),
    Box((0.66, 0.74, 0.10), (0.94, 0.75, 0.20), (236, 232, 222)),  # its label
    Box((0.02, 0.30, 0.00), (0.13, 0.40, 0.17), (170, 196, 160)),  # a tin
    Box((0.20, 0.26, 0.00), (0.33, 0.34, 0.055), (214, 120, 48)),  # a tool box
    Box((0.22, 0.28, 0.055), (0.31, 0.32, 0.068), (180, 182, 184)),  # its handle
    # a steel ruler on edge
    Box((0.445, 0.20, 0.00), (0.452, 0.21, 0.235), (198, 200, 202)),
    Box((0.49, 0.36, 0.00), (0.56, 0.43, 0.12), (236, 226, 180)),  # a block of notes
    Cable(
        ((-0.2, 0.9, 0.42), (0.15, 0.88, 0.24), (0.42, 0.86, 0.21), (0.75, 0.84, 0.36)),
        0.006,
        (226, 190, 40),
    ),
    Cable(
        ((0.36, 0.42, 0.004), (0.38, 0.40, 0.09), (0.60, 0.38, 0.16)),
        0.005,
        (230, 230, 226),
    ),
)
BENCH = {"desk": (184, 172, 150), "backdrop": (206, 205, 200), "panel": (120, 110, 98)}
BLUE_MAT = {
    "desk": (150, 172, 200),
    "backdrop": (222, 221, 216),
    "panel": (120, 118, 114),
}
GREY_DESK = BLUE_MAT | {"desk": (176, 178, 176)}
NIGHT = {"desk": (44, 44, 46), "backdrop": (58, 58, 62), "panel": (40, 40, 40)}
# a strong one, by the camera
SIDE_LAMP = Lamp(position=(0.10, -2.0, 0.80), size=0.04, share=0.35)
MAINS = Flicker(mains=50.0, depth=0.30, readout=0.008)
HALVES = Pattern("across", pitch=0.30, printed=((150, 24, 60),))
STRIPES = Pattern("across", pitch=0.008, printed=((24, 82, 70),))
CHECKS = Pattern("checks", pitch=0.012, printed=((40, 48, 96), (150, 24, 60)))
WHITE_CHECKS = Pattern("checks", pitch=0.015, printed=((226, 224, 218),))

DEFAULT_LOOK = "green-mat"
PLAIN = Look()  # a green mat before a green backdrop, as for chroma keying; even light
LOOKS: Mapping[str, Look] = {
    DEFAULT_LOOK: PLAIN,
    "arm-shadow": Look(BLUE_MAT, lamp=SIDE_LAMP),
    "blue-mat": Look(BLUE_MAT),  # antistatic and pale, before a white wall; even light
    "checks": Look(BLUE_MAT, pattern=CHECKS),
    "clutter": Look(BENCH, THINGS),
    "dark-on-dark": Look(NIGHT, pattern=Pattern(brightness=0.5)),
    "flicker": Look(BLUE_MAT, flicker=MAINS),
    "grey-desk": Look(GREY_DESK),  # before a white wall; even light
    "stripes": Look(BLUE_MAT, pattern=STRIPES),
    "two-colours": Look(BLUE_MAT, pattern=HALVES),
    "white-checks": Look(GREY_DESK, pattern=WHITE_CHECKS),  # as white as the wall
    "workshop": Look(
        colours=BENCH, things=THINGS, lamp=SIDE_LAMP, flicker=MAINS, pattern=HALVES
    ),
}


def check_look(name: str) -> str:
    """Return `name` if it names a look of the simulated cell; raises ValueError with
    all allowed names otherwise.
    """
    if name not in LOOKS:
        raise ValueError(f"there is no look {name!r}; allowed: {', '.join(LOOKS)}")
    return name
