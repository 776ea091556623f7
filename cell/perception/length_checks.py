"""Consistency checks of lengths that camera, arm and prediction measure
independently.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import hypot, nan

import numpy as np

from cell.perception.strip_measurement import StripMeasurement
from drivers.base.errors import in_mm
from drivers.base.geometry import lengths

DOUBTED, REFUTED = 4.0, 10.0  # spreads; 6e-5 of normal differences are larger than four
BY_HAND = 0.001  # m, assumed: how well a person lays an edge on a line
BY_TOOL = 0.0005  # m, assumed: how well an arm knows the point that its fingers hold
FEWEST_IMAGES = 10  # of the held end
SEEN_END = 0.025  # m from the gripper where the profile of a held strip still ends
LAST = 0.03  # m of the profile from which its hidden end is extrapolated
KINDS = {
    "free_edge": (
        "camera and stated length",
        (
            "lay the edges on their lines; if they lie there, check the length,"
            " calibrate the camera"
        ),
    ),
    "grip": (
        "camera and arm",
        "calibrate the camera and its latency; check the tool's point in the arm",
    ),
    "displacement": (
        "camera and prediction",
        (
            "something has changed since the strip was described or the cell"
            " calibrated: check the calibration with `cell calibrate check`, then `cell"
            " gap plan`"
        ),
    ),
    "edges": (
        "camera and arm",
        (
            "the strip slipped, stretched or sprang open, or the camera's map is off:"
            " look at the strip; if it lies as it was laid, calibrate the camera"
        ),
    ),
}
"""Who states each length, and what to look at where they disagree."""


@dataclass(frozen=True, slots=True)
class LengthCheck:
    """Difference [m] between two independent measurements of the length `name`, such as
    by camera and arm.

    `spread` is the standard deviation [m] that the difference usually has.
    """

    name: str
    difference: float
    spread: float

    @property
    def ratio(self) -> float:
        """Size of the difference in units of its standard deviation `spread`."""
        return abs(self.difference) / self.spread

    @property
    def refuted(self) -> bool:
        """Whether the two measured lengths differ so much that the measurement cannot
        be trusted.
        """
        return self.ratio > REFUTED

    def sentence(self) -> str:
        """Text for the operator: which lengths disagree, by how much, what to check."""
        sources, remedy = KINDS[self.name]
        return (
            f"{self.name.replace('_', ' ')}: {sources} differ by"
            f" {1e3 * self.difference:+.1f} mm, {self.ratio:.0f} times the usual"
            f" {in_mm(self.spread, 1)}; {remedy}"
        )

    def facts(self) -> dict[str, str | float]:
        """Entry of result.yaml for this check: name of the length, difference [m] and
        spread [m].
        """
        return {
            "name": self.name,
            "difference": round(self.difference, 6),
            "spread": round(self.spread, 6),
        }


def disagreements(witnesses: Iterable[LengthCheck]) -> tuple[LengthCheck, ...]:
    """Checks whose lengths differ by more than DOUBTED standard deviations, the worst
    first.
    """
    doubted = (witness for witness in witnesses if witness.ratio > DOUBTED)
    return tuple(sorted(doubted, key=lambda witness: -witness.ratio))


def held_end_offset(seen: StripMeasurement) -> float:
    """Offset x [m] of an upright strip's end from the gripper; NaN where hidden.

    Fingers hide the end itself, where the strip is upright: a parabola through what is
    seen below them leads there.
    """
    away = seen.profile - np.array(seen.gripper)
    if len(away) == 0 or lengths(away[-1]) >= SEEN_END:
        return nan
    x, z = away[lengths(away - away[-1]) <= LAST].T
    upright = np.column_stack([np.ones_like(z), z**2])
    return float(np.linalg.lstsq(upright, x)[0][0])


def compare_grip(offsets: Sequence[float], residual: float) -> tuple[LengthCheck, ...]:
    """Compare camera and arm by the held end's `offsets` [m]; empty for too few
    images.
    """
    known = np.array(offsets)[np.isfinite(offsets)]
    if len(known) < FEWEST_IMAGES:
        return ()
    spread = hypot(residual, BY_TOOL)
    return (LengthCheck("grip", float(np.median(known)), spread),)
