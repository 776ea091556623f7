"""Verdict on a lens calibration: the lens, two halves of the views compared, how flat
the board is, reasons for failure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import cv2
import numpy as np

from calibration.board import BoardSettings, BoardView
from calibration.lens import MINIMUM_VIEWS, Lens, LensFit, fit_lens
from calibration.wizard import coverage
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

NORMAL_STEP = 1e-4  # m, difference for the derivative along the board's normal
POSE_COLUMNS = 6  # of cv2.projectPoints' Jacobian
CAMERA_COLUMNS = slice(6, 14)  # of it: the lens but k3
BOW_MODES = 3  # of a bow: x^2, y^2, x y


def _bow_reasons(
    views: Sequence[BoardView], lens: Lens, settings: BoardSettings
) -> tuple[str, ...]:
    """Texts on why a board that is not flat is refused, since its bow falsifies the
    focal length; empty where it is flat.

    `lens` is the one fitted to `views` as if the board were flat.

    One Gauss-Newton step of the whole bundle, in which the board gains the heights a
    x^2 + b y^2 + c x y: the part of the corners' errors that these explain and lens and
    poses do not is the board's.
    """
    systems = [_pose_free_system(view, lens) for view in views]
    design = np.vstack([slopes for slopes, _ in systems])
    errors = np.concatenate([error for _, error in systems])

    scale = np.linalg.norm(design, axis=0)
    scaled = design / scale
    inverse = np.linalg.inv(scaled.T @ scaled)
    solution = inverse @ scaled.T @ errors / scale

    freedom = max(len(errors) - POSE_COLUMNS * len(views) - len(solution), 1)
    noise = np.sum((errors - design @ solution) ** 2) / freedom
    covariance = (noise * inverse / np.outer(scale, scale))[-BOW_MODES:, -BOW_MODES:]

    # heights at corners, middles of the sides and middle, about the middle: a tilt is
    # no bow
    grid = np.array([(x, y) for y in (-0.5, 0.0, 0.5) for x in (-0.5, 0.0, 0.5)])
    modes = _bow_modes(grid * np.ptp(settings.outline(), axis=0))
    heights = modes @ solution[-BOW_MODES:]

    lowest_to_highest = modes[np.argmax(heights)] - modes[np.argmin(heights)]
    sigma_mm = 1e3 * np.sqrt(lowest_to_highest @ covariance @ lowest_to_highest)
    height_mm = 1e3 * np.ptp(heights)
    is_bent = height_mm > max(settings.bow_mm, SEEN_SIGMA * sigma_mm)
    bent = (
        f"the board is bent by {height_mm:.1f} mm (+- {sigma_mm:.1f}), allowed"
        f" {settings.bow_mm:.1f} mm; glue it on glass or another flat and stiff plate"
    )
    return reasons((is_bent, bent))


def _pose_free_system(view: BoardView, lens: Lens) -> tuple[Array, Array]:
    """Derivatives of the corners' positions in one view by the numbers of the lens and
    by the board's bow, and the corners' errors [px], both without what the pose of the
    board can fit.

    The images of the view's n corners [px] are linearised about the best pose of a flat
    board.
    """
    camera = (lens.matrix, lens.distortion)
    board = view.board
    _, rotation, shift = cv2.solvePnP(board, view.image, *camera)
    image, slopes = cv2.projectPoints(board, rotation, shift, *camera)
    raised = board + np.array([0.0, 0.0, NORMAL_STEP])
    raised_image, _ = cv2.projectPoints(raised, rotation, shift, *camera)

    error = view.image.reshape(-1, 1) - image.reshape(-1, 1)
    by_height = (raised_image - image).reshape(-1, 1) / NORMAL_STEP
    bow = by_height * np.repeat(_bow_modes(board), 2, axis=0)
    system = np.hstack([slopes[:, CAMERA_COLUMNS], bow, error])

    pose = slopes[:, :POSE_COLUMNS]
    by_pose = np.linalg.lstsq(pose, system, rcond=None)[0]
    pose_free = system - pose @ by_pose
    return pose_free[:, :-1], pose_free[:, -1]


def _bow_modes(points: Array) -> Array:
    """Three terms [m^2] of which a bow of the board is made, for each row of `points`
    [m]: x squared, y squared, and x times y.
    """
    x, y = points[:, :2].T
    return np.stack([x * x, y * y, x * y], axis=1)


# mm between two halves at the board, up to which good, then fair
BEND_GRADES = (0.3, 1.0)
SEEN_SIGMA = 4.0  # sigma by which a bow or a difference of the halves is significant
# share of the image by which a principal point may lie off its centre
OFF_CENTRE = 0.15


@dataclass(frozen=True, slots=True)
class LensVerdict(CalibrationVerdict):
    """Verdict on a lens that was fitted to a number of `views` of the board.

    `bend_mm` is the largest difference of the distortion of two halves of the views, at
    the board's distance, after the best plane homography is removed. `per_view` is the
    rms [px] of the image with that number.
    """

    fit: LensFit | None = None
    bend_mm: float | None = None
    views: int = 0
    per_view: Mapping[int, float] = field(default_factory=dict)
    good: ClassVar[str] = "the lens may be used"
    refused: ClassVar[str] = "mend what is said above and go on"

    def facts(self) -> dict[str, Any]:
        """Plain values of the verdict on the lens, as the option `--json` prints and
        the session's verdict file keeps them.
        """
        return CalibrationVerdict.facts(self) | {
            "passed": self.passed,
            "views": self.views,
            "rms_px": None if self.fit is None else self.fit.rms,
            "halves_mm": self.bend_mm,
            "per_view_px": {str(number): rms for number, rms in self.per_view.items()},
        }


def lens_verdict(
    views: Mapping[int, BoardView],
    size: tuple[int, int],
    length: float | None,
    settings: BoardSettings,
) -> LensVerdict:
    """Verdict on the lens that fits `views`, which are given by number, in images of
    width and height `size` [px].

    `length` [m] is the ruler's length of the printed squares across all columns.
    """
    numbers = sorted(views, key=lambda number: tuple(views[number].image.mean(axis=0)))
    ordered = [views[number] for number in numbers]
    count = len(ordered)
    least = 2 * MINIMUM_VIEWS
    if count < least:
        reason = f"{count} views, at least {least} are needed; show more"
        return LensVerdict(views=count, reasons=(reason,))

    try:
        fit = fit_views(ordered, size)
        split, bend_mm = _differences_of_halves(ordered, fit.lens)
    except ConfigurationError as error:
        return LensVerdict(views=count, reasons=(str(error),))

    bow_reasons = _bow_reasons(ordered, fit.lens, settings)
    gates = coverage.gates(ordered, fit.lens, settings)
    refused = [*bow_reasons, *(str(gate) for gate in gates if not gate.passed)]
    if not bow_reasons:  # a bow causes these, too
        refused += _lens_reasons(fit, split, settings)

    refused += _length_reasons(length, settings)
    return LensVerdict(
        fit=fit,
        found=_found(count, fit, split, bend_mm),
        bend_mm=bend_mm,
        views=count,
        per_view=dict(sorted(zip(numbers, fit.per_view.tolist(), strict=True))),
        reasons=tuple(refused),
    )


def _found(views: int, fit: LensFit, split: float, bend_mm: float) -> tuple[Line, ...]:
    """Lines of text with a grade on a lens fitted to `views` views, of which two halves
    differ by the fraction `split` in focal length and by `bend_mm` [mm] at the board.
    """
    matrix = fit.lens.matrix
    u, v = matrix[:2, 2]
    halves = (
        f"two halves of the views bend the image alike within {bend_mm:.2f} mm at the"
        " board, "
    )
    halves += f"and differ by {100 * split:.2f} % in focal length"
    focal = f"focal length {matrix[0, 0]:.0f} px"
    return (
        Line(Level.PLAIN, f"{views} views, corners {fit.rms:.2f} px off (rms)"),
        Line(Level.PLAIN, f"{focal}, principal point {u:.0f}, {v:.0f} px"),
        grade_line(bend_mm, *BEND_GRADES, halves),
    )


def fit_views(views: Sequence[BoardView], size: tuple[int, int]) -> LensFit:
    """Fit of a lens to `views` of the board in images of width and height `size` [px];
    ConfigurationError where none can be fitted.
    """
    return fit_lens(
        [view.board for view in views], [view.image for view in views], size
    )


def _differences_of_halves(
    views: Sequence[BoardView], lens: Lens
) -> tuple[float, float]:
    """Differences of the lenses fitted to every second of `views` and to the others: in
    focal length, as a fraction, and in the image at the board's distance [mm].
    """
    size = lens.size
    one = fit_views(views[::2], size).lens
    other = fit_views(views[1::2], size).lens
    focal = float(lens.matrix[0, 0])
    split = abs(float(one.matrix[0, 0] - other.matrix[0, 0])) / focal
    depth = float(np.median([view.depth(lens) for view in views]))
    return split, 1e3 * _largest_difference(one, other) * depth / focal


def _lens_reasons(
    fit: LensFit, split: float, settings: BoardSettings
) -> tuple[str, ...]:
    """Texts on why a lens is refused: by its errors at corners, its focal length, the
    difference of two halves of the views, or its principal point.

    Noise of the corners explains a difference of halves of twice the whole's deviation;
    one beyond that and the tolerance has another cause.
    """
    lens = fit.lens
    deviation = fit.focal_deviation / float(lens.matrix[0, 0])
    allowed = max(settings.split, SEEN_SIGMA * 2.0 * deviation)
    off = np.abs(lens.matrix[:2, 2] / lens.size - 0.5).max()
    return reasons(
        (
            fit.rms > settings.rms,
            (
                f"corners are {fit.rms:.2f} px off, allowed {settings.rms:.2f}; "
                "hold the board still and flat"
            ),
        ),
        (
            deviation > settings.focal,
            (
                f"the focal length is known to {100 * deviation:.1f} % (one sigma),"
                f" allowed {100 * settings.focal:.1f} %; hold the board still, and tilt"
                " it more"
            ),
        ),
        (
            split > allowed,
            (
                f"two halves of the views differ by {100 * split:.1f} % in focal"
                f" length, allowed {100 * allowed:.1f} %; tilt the board more"
            ),
        ),
        (
            off > OFF_CENTRE,
            (
                f"the principal point lies {100 * off:.0f} % of the image off its"
                f" centre, allowed {100 * OFF_CENTRE:.0f} %; check width and height of"
                " the images, tilt the board more"
            ),
        ),
    )


def _length_reasons(length: float | None, settings: BoardSettings) -> tuple[str, ...]:
    """Texts on why a board is refused: its `length` [m] by a ruler contradicts its
    stated squares, or it is None because nobody has measured it.
    """
    columns = settings.columns
    stated = settings.width
    if length is None:
        return (
            (
                "no length of the board was measured; lay a ruler along its long side"
                f" and state the length of {columns} squares,"
                f" {1e3 * stated:.1f} mm as configured"
            ),
        )
    return reasons(
        (
            abs(length / stated - 1.0) > settings.length,
            (
                f"{columns} squares measure {1e3 * length:.1f} mm, configured"
                f" are {1e3 * stated:.1f} mm, {100 * (stated / length - 1.0):+.1f} %;"
                f" state boards.square: {length / columns:.5f} or print the"
                " board at 100 %"
            ),
        )
    )


def _largest_difference(one: Lens, other: Lens) -> float:
    """Largest difference [px] between two lenses over the image, beyond what a change
    of the board's plane can explain.
    """
    across = np.linspace(0.02, 0.98, 12)
    down = np.linspace(0.02, 0.98, 8)
    grid = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    pixels = grid * (one.width, one.height)
    by_one = one.undistort(pixels)
    by_other = other.undistort(pixels)
    between, _ = cv2.findHomography(by_other, by_one, 0)
    mapped = cv2.perspectiveTransform(by_other[None], between)[0]
    return float(lengths(mapped - by_one).max())
