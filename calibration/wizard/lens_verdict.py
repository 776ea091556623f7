"""Verdict on a lens calibration: the lens, two halves of the views compared,
reasons for failure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.board_settings import BoardSettings
from calibration.board_view import BoardView
from calibration.lens import MINIMUM_VIEWS, Lens, LensFit, fit_lens
from calibration.wizard.coverage import CoverageNeeds, coverage
from drivers.errors import ConfigurationError
from drivers.types import Array

OFF_CENTRE = 0.15  # share of the image by which a principal point may lie off its centre
NAN = float("nan")


@dataclass(frozen=True, slots=True)
class LensVerdict:
    """The lens fit, the difference between two independent halves of the views, and the reasons for
    failure.

    `split` is their relative difference in focal length; `bend_px` the largest difference of their
    distortion over the image after the best plane homography is removed, and `bend_mm` that at the
    board's distance. `per_view` is the rms [px] of the image with that number.
    """

    fit: LensFit | None
    split: float
    bend_px: float
    bend_mm: float
    views: int
    per_view: Mapping[int, float]
    reasons: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the lens may be used."""
        return self.fit is not None and not self.reasons


def lens_verdict(
    views: Mapping[int, BoardView],
    size: tuple[int, int] | None,
    length: float | None,
    settings: BoardSettings,
) -> LensVerdict:
    """The verdict on `views` by number of image, of `size` [px]; independent of their order.

    `length` [m] is the ruler's length of the printed squares across all columns.
    """
    numbers = sorted(views, key=lambda number: tuple(views[number].image.mean(axis=0)))
    ordered = [views[number] for number in numbers]
    if size is None or len(ordered) < 2 * MINIMUM_VIEWS:
        reason = f"{len(ordered)} views, at least {2 * MINIMUM_VIEWS} are needed; show more"
        return LensVerdict(None, NAN, NAN, NAN, len(ordered), {}, (reason,))
    try:
        fit = _fit(ordered, size)
        one, other = (_fit(ordered[start::2], size).lens for start in (0, 1))
    except ConfigurationError as error:
        return LensVerdict(None, NAN, NAN, NAN, len(ordered), {}, (str(error),))
    focal = float(fit.lens.matrix[0, 0])
    split = abs(float(one.matrix[0, 0] - other.matrix[0, 0])) / focal
    bend = _bend(one, other)
    depth = float(np.median([view.depth(fit.lens) for view in ordered]))
    reasons = [*_uncovered(ordered, fit.lens, settings), *_misfits(fit, split, settings)]
    reasons += _length(length, settings)
    per_view = dict(sorted(zip(numbers, fit.per_view.tolist(), strict=True)))
    bend_mm = 1e3 * bend * depth / focal
    return LensVerdict(fit, split, bend, bend_mm, len(ordered), per_view, tuple(reasons))


def needs(settings: BoardSettings) -> CoverageNeeds:
    """The coverage that the views must reach."""
    return CoverageNeeds(
        x=settings.range_x,
        y=settings.range_y,
        size=settings.range_size,
        skew=settings.skew,
        cells=settings.covered,
        views=settings.views,
        tilted=settings.tilted,
        tilted_views=settings.tilted_views,
    )


def _uncovered(views: Sequence[BoardView], lens: Lens, settings: BoardSettings) -> list[str]:
    gates = coverage(views, settings.outline(), lens, needs(settings))
    return [str(gate) for gate in gates if not gate.passed]


def _misfits(fit: LensFit, split: float, settings: BoardSettings) -> list[str]:
    """Defects of the lens itself."""
    reasons = []
    if fit.rms > settings.rms:
        reasons.append(
            f"corners are {fit.rms:.2f} px off, allowed {settings.rms:.2f}; "
            "hold the board still and flat"
        )
    if split > settings.split:
        reasons.append(
            f"two halves of the views differ by {100 * split:.1f} % in focal length, allowed "
            f"{100 * settings.split:.1f} %; tilt the board more"
        )
    lens = fit.lens
    off = np.abs(lens.matrix[:2, 2] / (lens.width, lens.height) - 0.5).max()
    if off > OFF_CENTRE:
        reasons.append(
            f"the principal point lies {100 * off:.0f} % of the image off its centre, allowed "
            f"{100 * OFF_CENTRE:.0f} %; check width and height of the images, tilt the board more"
        )
    return reasons


def _length(length: float | None, settings: BoardSettings) -> list[str]:
    """Difference between the ruler and the stated squares, which images cannot reveal."""
    stated = settings.width
    if length is None:
        return [
            "no length of the board was measured; lay a ruler along its long side and state the "
            f"length of {settings.columns} squares, {1e3 * stated:.1f} mm as configured"
        ]
    if abs(length / stated - 1.0) <= settings.length:
        return []
    return [
        f"{settings.columns} squares measure {1e3 * length:.1f} mm, configured are "
        f"{1e3 * stated:.1f} mm, {100 * (stated / length - 1.0):+.1f} %; state boards.square: "
        f"{length / settings.columns:.5f} or print the board at 100 %"
    ]


def _bend(one: Lens, other: Lens) -> float:
    """Largest difference [px] between two lenses over the image, after the best
    plane homography.
    """
    u, v = np.meshgrid(np.linspace(0.02, 0.98, 12), np.linspace(0.02, 0.98, 8))
    pixels = np.column_stack([u.ravel(), v.ravel()]) * (one.width, one.height)
    here, there = one.undistort(pixels), other.undistort(pixels)
    between, _ = cv2.findHomography(there, here, 0)
    mapped: Array = np.column_stack([there, np.ones(len(there))]) @ between.T
    return float(np.hypot(*(mapped[:, :2] / mapped[:, 2:] - here).T).max())


def _fit(views: Sequence[BoardView], size: tuple[int, int]) -> LensFit:
    return fit_lens([view.board for view in views], [view.image for view in views], size)
