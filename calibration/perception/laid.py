"""Offset between the edges of a laid fold, from its loop."""

from typing import NamedTuple, Self

import numpy as np

from calibration.perception.measurement import StripMeasurement

# Edge offset minus (length - 2 tip) of folds that lie: so much more strip than it is long a loop
# holds, per m of its height and width and of the strip's thickness. Least squares over 67 folds of
# the chain through images, 0.4 mm rms, most of them with yarn friction, stiffening or a seam
# (`tests.benchmarks.measure_unknown`).
ALWAYS, OF_HEIGHT, OF_WIDTH, OF_THICKNESS = -0.1e-3, -1.05, 0.615, -0.93
TOP = 5  # points of the profile whose mean height is the loop's


class Loop(NamedTuple):
    """The loop of a laid fold [m]: x of its rightmost point, its height, and its width from where
    the lower layer leaves the desk.
    """

    tip_x: float
    height: float
    width: float

    @classmethod
    def seen_in(cls, measurement: StripMeasurement) -> Self | None:
        """The loop in the image of a laid strip, None where it is not visible."""
        tip_x, heights = measurement.tip[0], np.sort(measurement.profile[:, 1:].ravel())
        if len(heights) < TOP or not np.isfinite(tip_x + measurement.contact_x):
            return None
        return cls(float(tip_x), float(heights[-TOP:].mean()), tip_x - measurement.contact_x)


def edge_offset(length: float, thickness: float, loop: Loop) -> float:
    """Offset of the grasped edge beyond the fixed one [m], with the sign of d.

    For a folded strip of `length` and `thickness` [m]. Its layers lie flat, so a tip 1 mm to the
    left leaves 2 mm more for the upper layer. What the loop holds follows from its size as seen,
    whatever made it: stiffness, friction between yarns, or a law that nobody knows.
    """
    held = ALWAYS + OF_HEIGHT * loop.height + OF_WIDTH * loop.width
    return length - 2.0 * loop.tip_x + held + OF_THICKNESS * thickness
