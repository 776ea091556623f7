"""Consistency checks of lengths that camera, arm and prediction measure
independently.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, nan
from pathlib import Path

import numpy as np

from cell.perception.strip_measurement import StripMeasurement
from drivers.base.errors import in_mm
from drivers.base.geometry import lengths
from drivers.base.readers import read_yaml

# Spreads: of a displacement, 0.3 % of right folds are SURPRISING. Lengths of the cell
# need more to be DOUBTED: their spread is a mean over strips, and one of ten differs
# by three of them in a right cell.
SURPRISING, DOUBTED, REFUTED = 3.0, 4.0, 10.0
BY_HAND = 0.001  # m, assumed: how well a person lays an edge on a line
BY_TOOL = 0.0005  # m, assumed: how well an arm knows the point that its fingers hold
FEWEST_IMAGES = 10  # of the held end
SEEN_END = 0.025  # m from the gripper where the profile of a held strip still ends
LAST = 0.03  # m of the profile from which its hidden end is extrapolated
ALIKE = 4.0  # squared spreads by which a cause may fit worse than the best one
SOURCES = {
    "free_edge": "camera and stated length",
    "grip": "camera and arm",
    "displacement": "camera and prediction",
    "edges": "camera and arm",
}
"""Who states each length."""
CHANGED = (
    "something has changed since the strip was described or the cell calibrated: lay a"
    " spirit level along the strip, check the calibration with `cell calibrate check`,"
    " then `cell gap plan`"
)
"""What to look at where a displacement is not as predicted."""


LENGTHS = ("free_edge", "grip", "edges")
CAUSES = read_yaml(Path(__file__).with_name("length_causes.yaml"))
"""What makes LENGTHS disagree, with its remedy, and by how many m each per m of it."""


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

    def sentence(self) -> str:
        """Text for the operator: which lengths disagree, and by how much."""
        return (
            f"{self.name.replace('_', ' ')}: {SOURCES[self.name]} differ by"
            f" {1e3 * self.difference:+.1f} mm, {self.ratio:.0f} times the usual"
            f" {in_mm(self.spread, 1)}"
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


def disagreements(
    witnesses: Sequence[LengthCheck], least: float = DOUBTED
) -> tuple[LengthCheck, ...]:
    """Checks whose lengths differ by more than `least` standard deviations, the worst
    first.
    """
    doubted = (witness for witness in witnesses if witness.ratio > least)
    return tuple(sorted(doubted, key=lambda witness: -witness.ratio))


def doubts(witnesses: Sequence[LengthCheck]) -> dict[str, str]:
    """Reasons to doubt lengths, by name: of the displacement from SURPRISING spreads
    on, of the cell's lengths from DOUBTED on.

    The latter have one reason: the worst, and the causes that explain them all.
    """
    reasons = {
        check.name: f"{check.sentence()}; {CHANGED}"
        for check in disagreements(witnesses, SURPRISING)
        if check.name not in LENGTHS
    }
    doubted = [check for check in disagreements(witnesses) if check.name in LENGTHS]
    for check in doubted:
        reasons[check.name] = f"{doubted[0].sentence()}; {_diagnosis(witnesses)}"
    return reasons


def _diagnosis(witnesses: Sequence[LengthCheck]) -> str:
    """Text of the causes, one at a time, that fit `witnesses` best or nearly so.

    Each has the size a [m] of least squares, where a length differs by a times the
    cause's share of it.
    """
    # of what was not measured, any difference is usual: 1 m
    known = {check.name: (check.difference, check.spread) for check in witnesses}
    differences, spreads = np.array([known.get(n, (0.0, 1.0)) for n in LENGTHS]).T
    measured = differences / spreads
    shares = np.array([*CAUSES.values()]) / spreads
    sizes = shares @ measured / (shares**2).sum(axis=1)
    misfits = ((measured - sizes[:, None] * shares) ** 2).sum(axis=1)

    ranked = sorted(zip(misfits, CAUSES, 1e3 * sizes, strict=True))
    return "; or ".join(
        cause.format(size)
        for misfit, cause, size in ranked
        if misfit < misfits.min() + ALIKE
    )


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
