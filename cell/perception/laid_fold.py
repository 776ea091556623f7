"""Offset between the edges of a laid fold, from the size of its loop in an image."""

from math import nan
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from cell.perception.strip_measurement import StripMeasurement
from drivers.base.geometry import arc_lengths
from drivers.base.settings import StudyResult

PROFILE_STRIDE = 8  # points of the profile, some 2 cm
TOP = 5  # points of the profile whose mean height is the loop's


class Loop(NamedTuple):
    """Loop of a laid fold: x of its tip, its height, and its width from desk contact to
    tip, all in metres.
    """

    tip_x: float
    height: float
    width: float

    @classmethod
    def seen_in(cls, measurement: StripMeasurement) -> Self | None:
        """Loop of a laid strip from its `measurement`; None where the loop is
        hidden.
        """
        tip_x = measurement.tip[0]
        heights = np.sort(measurement.profile[:, 1:].ravel())
        if len(heights) < TOP or not np.isfinite(tip_x + measurement.contact_x):
            return None
        return cls(
            float(tip_x), float(heights[-TOP:].mean()), tip_x - measurement.contact_x
        )


class LaidWeights(StudyResult):
    """Linear model of the strip length [m] within the loop of a laid fold, with its
    source.

    A constant [m], and per m of its height, its width and the strip's thickness.
    Written by `python -m tests.lab study unknown`, with what it was fitted to.
    """

    FILE = Path(__file__).with_suffix(".yaml")
    constant: float
    height: float
    width: float
    thickness: float
    rms: float
    folds: int


def laid_length(measurement: StripMeasurement) -> float:
    """Measured length [m] of a laid strip from edge to edge; NaN without a profile.

    Along every PROFILE_STRIDE-th point of the profile: of layers that lie on one
    another the points in between hold noise, which makes the curve longer by a tenth.
    """
    if len(measurement.profile) == 0:
        return nan
    points = measurement.profile[::PROFILE_STRIDE]
    curve = np.vstack([(measurement.contact_x, 0.0), points, measurement.gripper])
    return float(measurement.contact_x + arc_lengths(curve)[-1])


def edge_offset(length: float, thickness: float, loop: Loop) -> float:
    """Offset [m] of the grasped edge of a laid fold beyond the fixed edge, from its
    `loop`.

    For a folded strip of `length` and `thickness` [m]. Its layers lie flat, so a tip 1
    mm to the left leaves 2 mm more for the upper layer. What the loop holds follows
    from its size as seen, whatever made it: stiffness, friction between yarns, or a law
    that nobody knows.
    """
    model = LaidWeights.shipped()
    in_loop = model.constant + model.height * loop.height + model.width * loop.width
    in_loop += model.thickness * thickness
    return length - 2.0 * loop.tip_x + in_loop
