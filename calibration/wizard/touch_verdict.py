"""Verdicts from touched points: on the map fitted to them, and on a calibration already
in use.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from math import nan
from typing import Any, ClassVar

import cv2
import numpy as np

from calibration.calibration import Calibration, make_calibration
from calibration.homography import PlaneMap, homography_of
from calibration.lens import Lens
from calibration.wizard.latency import LatencySettings, LatencySteps, latency_verdict
from calibration.wizard.touches import (
    TouchedPoint,
    TouchFit,
    TouchSettings,
    camera_move,
    fit_touches,
)
from calibration.wizard.verdict import (
    CalibrationVerdict,
    Level,
    Line,
    grade_line,
    reasons,
)
from drivers.base.errors import ConfigurationError
from drivers.base.geometry import lengths
from drivers.base.types import Array

# mm, up to which good, then fair: worst point, difference of halves, effect on the
# displacement
WORST_GRADES, HALVES_GRADES, DISPLACEMENT_GRADES = (0.5, 1.0), (0.5, 1.5), (1.0, 2.0)
HALF_POINTS = 6  # points from which half a map is still worth comparing
ORIENTATION_STEP = 0.01  # m, side of the triangle by which a mirrored map is detected
# an error e of x lengthens one layer and shortens the other: d is off by 2 e
DISPLACEMENT_FACTOR = 2.0
FEWEST_POINTS = 3  # least number of points from which to judge a map
ANEW = "run `cell calibrate homography` again"


@dataclass(frozen=True, slots=True)
class TouchVerdict(CalibrationVerdict):
    """Verdict on a map from the image to the plane of the strip: the map, and its
    errors [mm] at points held out of the fit.

    `residual_mm` is their rms; `halves_mm` the largest difference over the work area
    between two maps from independent halves of the points; `displacement_mm` the rms
    effect of the errors along x on the displacement. `errors_mm` is the distance of the
    point with that number, held out or not; `rejected` are the points that are left
    out, by number and as text, `wild` likewise first touches that a second one
    replaced.
    """

    plane_map: PlaneMap | None = None
    residual_mm: float = nan
    median_mm: float = nan
    worst_mm: float = nan
    halves_mm: float = nan
    displacement_mm: float = nan
    used: int = 0
    held_out: int = 0
    errors_mm: dict[int, float] = field(default_factory=dict)
    rejected: Mapping[int, str] = field(default_factory=dict)
    wild: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class CheckVerdict(CalibrationVerdict):
    """Verdict on a calibration that is already in use: its errors [mm] at newly touched
    points, by their numbers.

    `median_mm` and `worst_mm` are NaN without points.
    """

    errors_mm: dict[int, float]
    median_mm: float
    worst_mm: float
    good: ClassVar[str] = "this calibration still holds"
    refused: ClassVar[str] = "it no longer holds"

    def facts(self) -> dict[str, Any]:
        """Plain values of the verdict on a calibration in use, as the option `--json`
        prints them.
        """
        return CalibrationVerdict.facts(self) | {
            "passed": self.passed,
            "errors_mm": {
                str(number): error for number, error in self.errors_mm.items()
            },
            "median_mm": self.median_mm,
            "worst_mm": self.worst_mm,
        }


def touch_verdict(
    touches: Sequence[TouchedPoint], lens: Lens, settings: TouchSettings
) -> TouchVerdict:
    """Verdict on the map from the image to the plane that best fits `touches`, seen
    through `lens`.
    """
    try:
        fit = fit_touches(touches, lens, settings)
    except ConfigurationError as error:
        held_out = len({touch.number for touch in touches if touch.held_out})
        return TouchVerdict(held_out=held_out, reasons=(str(error),))
    verdict = _compose(fit, settings)
    causes = _causes(touches, fit, settings)
    # they bring all others along
    return replace(verdict, reasons=causes) if causes else verdict


def check_verdict(
    touches: Sequence[TouchedPoint], calibration: Calibration, settings: TouchSettings
) -> CheckVerdict:
    """Verdict on `calibration`, which is in use, from new `touches` to which it was not
    fitted.
    """
    off = [
        calibration.to_plane(touch.pixel[None])[0] - touch.position for touch in touches
    ]
    off_mm = 1e3 * np.reshape(off, (-1, 2))
    values = lengths(off_mm)
    count = len(values)
    numbers = [touch.number for touch in touches]
    errors = dict(zip(numbers, values.tolist(), strict=True))
    median = float(np.median(values)) if count else nan
    worst = float(values.max()) if count else nan
    text = f"half of {count} touched points are under {median:.2f} mm off, the worst "
    found = (grade_line(worst, *WORST_GRADES, f"{text}{worst:.2f}"),) if errors else ()
    if count < FEWEST_POINTS:
        few = (
            f"{count} points were touched, at least {FEWEST_POINTS} must decide;"
            " touch more"
        )
        return CheckVerdict(errors, median, worst, found=found, reasons=(few,))

    causes = _common_shift(off_mm, settings) or reasons(
        (
            worst > settings.worst_mm,
            (
                f"a point is {worst:.2f} mm off, allowed {settings.worst_mm:.2f}: the"
                f" camera or the arm's base has moved, or the pointer is loose; {ANEW}"
            ),
        ),
        (
            median > settings.median_mm,
            (
                f"half of the points are more than {median:.2f} mm off, allowed"
                f" {settings.median_mm:.2f}; {ANEW}"
            ),
        ),
    )
    return CheckVerdict(errors, median, worst, found=found, reasons=causes)


@dataclass(frozen=True, slots=True)
class MapVerdict(CalibrationVerdict):
    """Verdict on a map to the plane and on the camera's `latency` [s] together, with
    the `calibration` made of both.

    `calibration` is None unless it is accepted, possibly in spite of reasons.
    """

    touches: TouchVerdict
    latency: float | None
    calibration: Calibration | None
    good: ClassVar[str] = "this calibration may be used"
    refused: ClassVar[str] = "mend what is said above and touch again"

    @property
    def passed(self) -> bool:
        """Whether a calibration was made, in spite of reasons against it or without
        any.
        """
        return self.calibration is not None

    def facts(self) -> dict[str, Any]:
        """Plain values of the verdict on map and latency, as the option `--json` prints
        and the session's verdict file keeps them.
        """
        keys = ("residual_mm", "worst_mm", "halves_mm", "displacement_mm")
        errors = self.touches.errors_mm
        return CalibrationVerdict.facts(self) | {
            "accepted": self.passed,
            "calibration": None if self.calibration is None else self.calibration.id,
            **{key: getattr(self.touches, key) for key in keys},
            "latency": self.latency,
            "errors_mm": {str(number): error for number, error in errors.items()},
        }


def map_verdict(
    touches: TouchVerdict,
    steps: LatencySteps,
    settings: LatencySettings,
    *,
    anyway: bool = False,
    **facts: Any,
) -> MapVerdict:
    """Verdict on the map in `touches` and on the latency measured from `steps`, with a
    calibration unless there are reasons to refuse it.

    `facts` are further values of `make_calibration`. Reasons for refusal are overridden
    by `anyway`, but no calibration is made without a map.
    """
    fitted = touches.plane_map
    late = latency_verdict(steps, fitted, settings)
    refused = (*touches.reasons, *late.reasons)
    made = None
    if fitted is not None and (anyway or not refused):
        made = make_calibration(
            fitted.lens,
            fitted.homography,
            residual_mm=touches.residual_mm,
            latency=late.latency or 0.0,
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            accepted_anyway=refused,
            **facts,
        )

    found = (*touches.found, *late.found)
    clean = touches.clean
    return MapVerdict(
        touches, late.latency, made, found=found, reasons=refused, clean=clean
    )


def _common_shift(off: Array, settings: TouchSettings) -> tuple[str, ...]:
    """Text on why a calibration is refused whose errors `off` [mm], a row for each
    point, share one shift, as after a move of the camera; empty where they do not.
    """
    shared = np.median(off, axis=0)
    apart = lengths(off - shared).max()
    size = lengths(shared)
    return reasons(
        (
            size > max(settings.good_mm, 2.0 * apart),
            (
                f"all points are seen {size:.1f} mm off in the same direction: the"
                " camera or the arm's base has moved since the calibration; fasten it,"
                f" {ANEW}"
            ),
        )
    )


def _causes(
    touches: Sequence[TouchedPoint], fit: TouchFit, settings: TouchSettings
) -> tuple[str, ...]:
    """Texts on the one cause that explains all other errors: a mirrored plane, or a
    camera that was moved; empty where neither does.
    """
    middle = np.mean([touched.position for touched in touches], axis=0)
    triangle = middle + ORIENTATION_STEP * np.array([(0, 0), (1, 0), (0, 1)])
    corners = fit.homography.to_image(triangle)
    # z is up, v down: a true map turns it over
    if np.linalg.det(corners[1:] - corners[0]) >= 0:
        return (
            (
                "the touches are mirrored: x, z of the arm run in the image as seen"
                " from behind the strip; check that the picture is not flipped, on"
                " which side the camera stands, and the yaw of installation.mounting"
            ),
        )

    move = camera_move(touches, fit.lens, fit.homography, settings.good_mm)
    if move is None:
        return ()

    return (
        (
            f"all points after number {move.after} are seen {move.shift_mm:.1f} mm"
            f" elsewhere: the camera moved, as by a turn of {move.mrad:.1f} mrad, or"
            " the pointer slipped in the fingers; fasten both and touch all points"
            " again"
        ),
    )


def _compose(fit: TouchFit, settings: TouchSettings) -> TouchVerdict:
    """Verdict on a fitted map, with its errors at points held out of the fit, the
    rejected points, and grades.
    """
    validation = fit.validation
    held_out = np.reshape([fit.error(p) for p in validation], (-1, 2))
    errors = 1e3 * lengths(held_out)
    points = sorted((*fit.used, *validation), key=lambda p: p.number)
    rejected = [p for p in fit.outliers if p not in validation]
    verdict = TouchVerdict(
        plane_map=fit,
        residual_mm=_rms(errors),
        median_mm=float(np.median(errors)) if len(errors) else nan,
        worst_mm=float(errors.max(initial=0.0)),
        halves_mm=_halves_mm(points, fit.lens, settings),
        displacement_mm=DISPLACEMENT_FACTOR * _rms(1e3 * held_out[:, 0]),
        used=len(fit.used),
        held_out=len(validation),
        errors_mm={p.number: 1e3 * float(lengths(fit.error(p))) for p in points},
        rejected=fit.describe(rejected),
        wild=fit.describe(fit.replaced),
        clean=not rejected and _rms(errors) <= settings.good_mm,
    )
    refused = (*_map_reasons(verdict, settings), *_point_reasons(fit, settings))
    return replace(verdict, found=_found(verdict), reasons=refused)


def _found(verdict: TouchVerdict) -> tuple[Line, ...]:
    """Lines of text with a grade on how well the fitted map of `verdict` meets the
    touched points, and on points that lie far off or were left out.
    """
    return (
        grade_line(
            verdict.worst_mm,
            *WORST_GRADES,
            f"{verdict.held_out} points that were not fitted are"
            f" {verdict.residual_mm:.2f} mm off (rms), half of them under"
            f" {verdict.median_mm:.2f}, the worst {verdict.worst_mm:.2f}",
        ),
        grade_line(
            verdict.halves_mm,
            *HALVES_GRADES,
            "two maps from halves of the points agree within"
            f" {verdict.halves_mm:.2f} mm",
        ),
        grade_line(
            verdict.displacement_mm,
            *DISPLACEMENT_GRADES,
            f"by this a displacement errs by {verdict.displacement_mm:.2f} mm (rms)",
        ),
        *(
            Line(Level.FAIR, f"{text}; touched again, where it agrees")
            for text in verdict.wild.values()
        ),
        *(Line(Level.FAIR, f"{text}; left out") for text in verdict.rejected.values()),
    )


def _halves_mm(
    points: Sequence[TouchedPoint], lens: Lens, settings: TouchSettings
) -> float:
    """Largest difference [mm], over the work area, between the two maps that are fitted
    to random halves of `points`; NaN where there are too few of them.
    """
    if len(points) < 2 * HALF_POINTS:
        return nan
    ordered = sorted(points, key=lambda point: (*point.position, point.number))
    pixels = lens.undistort(np.array([point.pixel for point in ordered]))
    positions = np.array([point.position for point in ordered])

    order = np.random.default_rng(0).permutation(len(ordered))
    one, other = (
        homography_of(pixels[half], positions[half])
        for half in (order[::2], order[1::2])
    )

    # over a grid of the work area
    x = np.linspace(settings.x_min, settings.x_max, 7)
    z = np.linspace(settings.z_min, settings.z_max, 5)
    area = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
    through_both = other.to_plane(one.to_image(area))
    return 1e3 * float(lengths(through_both - area).max())


def _map_reasons(verdict: TouchVerdict, settings: TouchSettings) -> tuple[str, ...]:
    """Texts on why a map is refused because of its errors and the number of its points;
    empty where it is good.
    """
    rejected = "; ".join(verdict.rejected.values())
    return reasons(
        (
            verdict.held_out < FEWEST_POINTS,
            (
                f"{verdict.held_out} held-out points, at least {FEWEST_POINTS} must"
                " decide; touch more"
            ),
        ),
        (
            verdict.worst_mm > settings.worst_mm,
            (
                f"a held-out point is {verdict.worst_mm:.2f} mm off, allowed"
                f" {settings.worst_mm:.2f}; check that the pointer is tight and the"
                " camera has not moved"
            ),
        ),
        (
            verdict.median_mm > settings.median_mm,
            (
                f"half of the held-out points are more than {verdict.median_mm:.2f} mm"
                f" off, allowed {settings.median_mm:.2f}; calibrate the lens again,"
                " with more tilt"
            ),
        ),
        (
            verdict.halves_mm > settings.halves_mm,
            (
                f"maps from two halves of the points differ by {verdict.halves_mm:.2f}"
                f" mm, allowed {settings.halves_mm:.2f}; touch more points"
            ),
        ),
        (
            len(verdict.rejected) > settings.rejected,
            f"{rejected}; check that the pointer is tight, touch again",
        ),
    )


def _point_reasons(fit: TouchFit, settings: TouchSettings) -> tuple[str, ...]:
    """Texts on why a map is refused because of the touched points: too many lie far
    off, or they cover too little of the work area.
    """
    numbers = {p.number for p in (*fit.used, *fit.validation, *fit.outliers)}
    repeated = ", ".join(str(p.number) for p in fit.repeated_outliers)
    area = (settings.x_max - settings.x_min) * (settings.z_max - settings.z_min)
    positions = np.array([p.position for p in fit.used], dtype=np.float32)
    share = cv2.contourArea(cv2.convexHull(positions)) / area
    return reasons(
        (
            len(fit.replaced) > settings.wild * len(numbers),
            (
                f"{len(fit.replaced)} of {len(numbers)} first touches were wild; the"
                " pointer is loose or something else in the image looks like it;"
                " fasten it, cover bright discs"
            ),
        ),
        (
            bool(fit.repeated_outliers),
            (
                f"points {repeated} are off in the same way when touched again: the"
                " lens is wrong there or the arm leaves the plane; calibrate the lens"
                " again, check the plane"
            ),
        ),
        (
            share < settings.spread,
            (
                f"the points that agree enclose {100 * share:.0f} % of the work area,"
                f" at least {100 * settings.spread:.0f} % are needed; touch its"
                " corners too"
            ),
        ),
    )


def _rms(values: Array) -> float:
    """Root mean square of `values`; NaN where there are none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else nan
