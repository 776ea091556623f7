"""Sizes for image processing, in pixels of one camera."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibration.calibration import Calibration

# m: chosen on the twin's camera of 0.59 mm/px, which sees a pixel of blur
LIGHT_WINDOW = 0.047
HANGING_WINDOW = 0.0053
LONGEST_BRIDGE = 0.026
FINGER_DISTANCE = 0.0176
PROBE_DEPTH = 0.014


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes for image processing, in pixels of one camera with a resolution of `scale` [m/px].

    The first are lengths on the strip, scaled by the camera; the others follow from the pixel grid
    and a lens's blur of about a pixel, alike for every camera.
    """

    scale: float  # m/px
    light: int  # patches (odd) over whose median light is read: a strip covers less than half
    hanging: int  # px (odd) over which an edge-on strip is averaged along its way
    bridge: float  # px, longest break of an edge-on strip that is bridged
    aside: float  # px about the gripper point within which the fingers end the strip
    deep: float  # px to which a line across the outline reaches into the strip

    outside: float = 4.0  # px before the outline from where such a line starts
    step: float = 0.5  # px between its samples
    speck: int = 12  # px of outline; shorter ones are noise
    smooth: int = 4  # px along the outline to either side of which directions are averaged
    arm: int = 8  # px: an outline that comes as near to itself as `turn` so far from a tip
    turn: float = 5.0  # px  turns there
    thin: tuple[float, float] = (2.5, 4.5)  # px: narrower bands are read by their centre of mass
    agree: float = 2.5  # px by which a band may be narrower or wider than geometry says
    close: tuple[float, float] = (0.6, 1.2)  # px: an inner border this near to its place is the
    # near edge

    @classmethod
    def of(cls, calibration: Calibration, patch: int) -> Self:
        """Sizes for the camera of `calibration`; brightness is read by patches, `patch` [px] wide.

        At least what a strip of two pixels needs, however coarse the camera is.
        """
        scale = metres_per_pixel(calibration)
        return cls(
            scale=scale,
            light=max(_odd(LIGHT_WINDOW / scale / patch), 3),
            hanging=max(_odd(HANGING_WINDOW / scale), 5),
            bridge=LONGEST_BRIDGE / scale,
            aside=FINGER_DISTANCE / scale,
            deep=max(PROBE_DEPTH / scale, 8.0),
        )


def metres_per_pixel(calibration: Calibration) -> float:
    """Resolution [m/px] of the calibrated camera at the centre of its image."""
    lens = calibration.lens
    middle = np.array([(lens.width / 2, lens.height / 2), (lens.width / 2 + 1, lens.height / 2)])
    return float(np.hypot(*np.diff(calibration.to_plane(middle), axis=0)[0]))


def _odd(size: float) -> int:
    return 2 * round((size - 1) / 2) + 1
