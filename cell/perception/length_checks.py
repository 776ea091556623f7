"""Checks that lengths agree which camera, arm and prediction measure independently."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np

from cell.perception.measurement import StripMeasurement

DOUBTED, REFUTED = 4.0, 10.0  # spreads; 6e-5 of normal differences are larger than four
BY_HAND = 0.001  # m, assumed: how well a person lays an edge on a line
BY_TOOL = 0.0005  # m, assumed: how well an arm knows the point that its fingers hold
FEWEST_IMAGES = 10  # of the held end
SEEN_END = 0.01  # m from the gripper where the profile of a held strip still ends
KINDS = {
    "free_edge": (
        "camera and stated length",
        "lay the edges on their lines; if they lie there, check the length, calibrate the camera",
    ),
    "grip": (
        "camera and arm",
        "calibrate the camera and its latency; check the tool's point in the arm",
    ),
    "displacement": (
        "camera and prediction",
        "something has changed since the strip was described or the cell calibrated: check the "
        "calibration with `cell calibrate check`, then `cell gap plan`",
    ),
    "edges": (
        "camera and arm",
        "the strip slipped, stretched or sprang open, or the camera's map is off: look at the "
        "strip; if it lies as it was laid, calibrate the camera",
    ),
}
"""Who states each length, and what to look at where they disagree."""


@dataclass(frozen=True, slots=True)
class LengthCheck:
    """Difference [m] of two sources of the length `name`, one of KINDS.

    `parts` are the standard deviations [m] that the difference usually has, by their origin.
    """

    name: str
    difference: float
    parts: Mapping[str, float]

    @property
    def spread(self) -> float:
        """Standard deviation [m] of all parts together."""
        return hypot(*self.parts.values())

    @property
    def ratio(self) -> float:
        """Size of the difference, in spreads."""
        return abs(self.difference) / self.spread

    @property
    def refuted(self) -> bool:
        """Whether the difference is so large that the measurement is not to be trusted."""
        return self.ratio > REFUTED

    def sentence(self) -> str:
        """The disagreement as text for the operator: what, by how much, and what to look at."""
        sources, remedy = KINDS[self.name]
        origin = ", ".join(f"{what} {1e3 * sigma:.2f} mm" for what, sigma in self.parts.items())
        return (
            f"{self.name.replace('_', ' ')}: {sources} differ by {1e3 * self.difference:+.1f} mm, "
            f"{self.ratio:.0f} times their spread of {1e3 * self.spread:.1f} mm ({origin}); "
            f"{remedy}"
        )

    def facts(self) -> dict[str, str | float]:
        """Name, difference and spread [m] for programs."""
        return {
            "name": self.name,
            "difference": round(self.difference, 6),
            "spread": round(self.spread, 6),
        }


def disagreements(witnesses: Iterable[LengthCheck]) -> tuple[LengthCheck, ...]:
    """The checks that differ by more than DOUBTED spreads, the worst first."""
    doubted = (witness for witness in witnesses if witness.ratio > DOUBTED)
    return tuple(sorted(doubted, key=lambda witness: -witness.ratio))


def held_end(seen: StripMeasurement) -> float:
    """Offset [m] along x of an upright strip's visible end from the gripper; NaN where hidden."""
    if len(seen.profile) == 0:
        return float("nan")
    dx, dz = seen.profile[-1] - seen.gripper
    return float(dx) if hypot(dx, dz) < SEEN_END else float("nan")


def compare_grip(offsets: Sequence[float], residual: float) -> tuple[LengthCheck, ...]:
    """LengthCheck of the held end from its `offsets` [m] in images; none where too few show it.

    `residual` [m] is that of the calibration's map.
    """
    known = np.array(offsets)[np.isfinite(offsets)]
    if len(known) < FEWEST_IMAGES:
        return ()
    return (LengthCheck("grip", float(np.median(known)), {"map": residual, "held point": BY_TOOL}),)
