"""Verdict on touched points: the map, its errors at held-out points, reasons for failure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import cv2
import numpy as np

from calibration.homography import Homography, Rejected
from calibration.lens import Lens
from calibration.touch_settings import TouchSettings
from calibration.wizard.touch_fit import Solved, Touched, solve
from drivers.errors import ConfigurationError
from drivers.types import Array

NAN = float("nan")
HALF = 6  # points from which half a map is still worth comparing
SHIFT = 2.0  # an error e of x lengthens one layer and shortens the other: d is off by 2 e


class Grade(StrEnum):
    """Usability grades of a map."""

    GOOD = "good"
    USABLE = "usable"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class TouchVerdict:
    """The map, its errors [mm] at held-out points, and the reasons for failure.

    `residual_mm` is their rms; `halves_mm` the largest difference over the work area between two
    maps from independent halves of the points; `displacement_mm` the rms effect of the errors along
    x on the displacement. `errors_mm` is the distance of the point with that number, held out or
    not; `rejected` names points that are left out, `wild` first touches that a second one replaced;
    `reasons` is empty when `passed`.
    """

    homography: Homography | None
    residual_mm: float
    median_mm: float
    worst_mm: float
    halves_mm: float
    displacement_mm: float
    used: int
    held_out: int
    errors_mm: dict[int, float]
    rejected: tuple[Rejected, ...]
    wild: tuple[Rejected, ...]
    reasons: tuple[str, ...]
    grade: Grade

    @property
    def passed(self) -> bool:
        """Whether the map may be used."""
        return self.grade is not Grade.REFUSED


def touch_verdict(touches: Sequence[Touched], lens: Lens, settings: TouchSettings) -> TouchVerdict:
    """The verdict on `touches`, seen through `lens`; independent of their order."""
    try:
        solved = solve(touches, lens, settings)
    except ConfigurationError as error:
        decide = len({t.number for t in touches if t.held_out})
        return TouchVerdict(
            None, NAN, NAN, NAN, NAN, NAN, 0, decide, {}, (), (), (str(error),), Grade.REFUSED
        )
    return _verdict(solved, settings)


def _verdict(solved: Solved, settings: TouchSettings) -> TouchVerdict:
    decide = np.reshape([solved.error(p) for p in solved.decide], (-1, 2))
    errors = 1e3 * np.hypot(*decide.T)
    points = sorted((*solved.used, *solved.decide), key=lambda p: p.number)
    left_out = [p for p in solved.off if p not in solved.decide]
    verdict = TouchVerdict(
        homography=solved.homography,
        residual_mm=_rms(errors),
        median_mm=float(np.median(errors)) if len(errors) else NAN,
        worst_mm=float(errors.max(initial=0.0)),
        halves_mm=_halves_mm((*solved.used, *solved.decide), solved.lens, settings),
        displacement_mm=SHIFT * _rms(1e3 * decide[:, 0]),
        used=len(solved.used),
        held_out=len(solved.decide),
        errors_mm={p.number: 1e3 * float(np.hypot(*solved.error(p))) for p in points},
        rejected=tuple(solved.named(p) for p in sorted(left_out, key=lambda p: p.number)),
        wild=tuple(solved.named(p) for p in sorted(solved.wild, key=lambda p: p.number)),
        reasons=(),
        grade=Grade.GOOD,
    )
    reasons = (*_reasons(verdict, settings), *_lacking(solved, settings))
    return replace(verdict, reasons=reasons, grade=_grade(verdict, reasons, settings))


def _halves_mm(points: Sequence[Touched], lens: Lens, settings: TouchSettings) -> float:
    """Difference [mm] over the work area between maps from two random halves of the points."""
    ordered = sorted(points, key=lambda p: (p.place[0], p.place[1], p.number))
    order = np.random.default_rng(0).permutation(len(ordered))
    x = np.linspace(settings.x_min, settings.x_max, 7)
    z = np.linspace(settings.z_min, settings.z_max, 5)
    area = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
    maps = []
    for half in (order[::2], order[1::2]):
        if len(half) < HALF:
            return NAN
        pixels = lens.undistort(np.array([ordered[i].pixel for i in half]))
        places = 1e3 * np.array([ordered[i].place for i in half])
        matrix, _ = cv2.findHomography(places, pixels, 0)
        maps.append(Homography.of(np.linalg.inv(matrix)))
    there = maps[1].to_plane(maps[0].to_image(1e3 * area))
    return float(np.hypot(*(there - 1e3 * area).T).max())


def _reasons(verdict: TouchVerdict, settings: TouchSettings) -> list[str]:
    """Defects of the map's numbers."""
    reasons = []
    if verdict.held_out < 3:
        reasons.append(f"{verdict.held_out} held-out points, at least 3 must decide; touch more")
    if verdict.worst_mm > settings.worst_mm:
        reasons.append(
            f"a held-out point is {verdict.worst_mm:.2f} mm off, allowed {settings.worst_mm:.2f}; "
            "check that the pointer is tight and the camera has not moved"
        )
    if verdict.median_mm > settings.median_mm:
        reasons.append(
            f"half of the held-out points are more than {verdict.median_mm:.2f} mm off, allowed "
            f"{settings.median_mm:.2f}; calibrate the lens again, with more tilt"
        )
    if verdict.halves_mm > settings.halves_mm:
        reasons.append(
            f"maps from two halves of the points differ by {verdict.halves_mm:.2f} mm, allowed "
            f"{settings.halves_mm:.2f}; touch more points"
        )
    if len(verdict.rejected) > settings.rejected:
        named = "; ".join(str(point) for point in verdict.rejected)
        reasons.append(f"{named}; check that the pointer is tight, touch again")
    return reasons


def _lacking(solved: Solved, settings: TouchSettings) -> list[str]:
    """Defects of the points themselves."""
    reasons = []
    numbers = {p.number for p in (*solved.used, *solved.decide, *solved.off)}
    if len(solved.wild) > settings.wild * len(numbers):
        reasons.append(
            f"{len(solved.wild)} of {len(numbers)} first touches were wild; the pointer is loose "
            "or something else in the image looks like it; fasten it, cover bright discs"
        )
    if solved.stubborn:
        named = ", ".join(str(p.number) for p in solved.stubborn)
        reasons.append(
            f"points {named} are off in the same way when touched again: the lens is wrong there "
            "or the arm leaves the plane; calibrate the lens again, check the plane"
        )
    area = (settings.x_max - settings.x_min) * (settings.z_max - settings.z_min)
    places = np.array([p.place for p in solved.used], dtype=np.float32)
    share = float(cv2.contourArea(cv2.convexHull(places))) / area
    if share < settings.spread:
        reasons.append(
            f"the points that agree enclose {100 * share:.0f} % of the work area, at least "
            f"{100 * settings.spread:.0f} % are needed; touch its corners too"
        )
    return reasons


def _grade(verdict: TouchVerdict, reasons: Sequence[str], settings: TouchSettings) -> Grade:
    if reasons:
        return Grade.REFUSED
    clean = not verdict.rejected and verdict.residual_mm <= settings.good_mm
    return Grade.GOOD if clean else Grade.USABLE


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else NAN
