"""Touched points: the plan of poses, the robust fit of the map, detection of a moved
camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from math import pi
from typing import Annotated

import numpy as np
from pydantic import Field

from calibration.homography import (
    MINIMUM_POINTS,
    Homography,
    PlaneMap,
    fit_homography,
    transform,
)
from calibration.lens import Lens
from drivers.base.errors import ConfigurationError
from drivers.base.geometry import lengths, robust_sigma
from drivers.base.settings import Settings, Share
from drivers.base.types import Array, Pose

Count = Annotated[int, Field(ge=3, le=12)]
Millimetres = Annotated[float, Field(gt=0, le=10)]


class TouchSettings(Settings):
    """Settings of the touch calibration: poses, images per point, and acceptance
    criteria.

    The points lie on a grid of `columns` x `rows` over the work area [m]; every
    `hold_out`-th is held out of the fit and used for the verdict. An image is accepted
    when two in a row agree within `still` [px] and the arm within `arm_still` [m]. A
    point that disagrees is touched once more.
    """

    x_min: float = Field(0.02, ge=-0.5, le=1.0)
    x_max: float = Field(0.60, gt=0, le=2.0)
    z_min: float = Field(0.015, ge=0.0, le=0.2)
    z_max: float = Field(0.30, gt=0, le=1.0)
    columns: Count = 6
    rows: Count = 4
    hold_out: int = Field(4, ge=2, le=10)
    still: float = Field(0.3, gt=0, le=2)
    arm_still: float = Field(0.0005, gt=0, le=0.005)
    patience: int = Field(8, ge=2, le=100)  # images at one pose before it is given up
    worst_mm: Millimetres = 1.0  # allowed at the held-out points
    median_mm: Millimetres = 0.5  # likewise, their median
    halves_mm: Millimetres = 1.5  # by which maps from two halves may differ
    good_mm: Millimetres = 0.3  # rms under which there is nothing to improve
    rejected: int = Field(2, ge=0, le=10)  # points that may be left out at the end
    # share of the first touches that may be wild
    wild: float = Field(0.25, gt=0, lt=0.5)
    spread: Share = 0.6  # of the work area, that used points enclose


def touch_plan(settings: TouchSettings) -> tuple[Pose, ...]:
    """Poses of the pointer on a grid over the work area, row by row, alternately to the
    right and to the left.
    """
    xs = np.linspace(settings.x_min, settings.x_max, settings.columns).tolist()
    zs = np.linspace(settings.z_min, settings.z_max, settings.rows).tolist()
    rows = [(xs[:: -1 if row % 2 else 1], z) for row, z in enumerate(zs)]
    return tuple(Pose(x, z, pi / 2) for columns, z in rows for x in columns)


def check_plan(settings: TouchSettings) -> tuple[Pose, ...]:
    """Five poses of the pointer by which a calibration in use is checked: at the
    corners and in the middle of the work area.
    """
    left = settings.x_min
    right = settings.x_max
    low = settings.z_min
    high = settings.z_max
    middle = ((left + right) / 2, (low + high) / 2)
    positions = [(left, low), (right, low), middle, (right, high), (left, high)]
    return tuple(Pose(x, z, pi / 2) for x, z in positions)


def require_enough(plan: Sequence[Pose], settings: TouchSettings) -> None:
    """Raise ConfigurationError where the poses of `plan` leave fewer points to fit than
    a map needs.
    """
    fitted = sum(not held_out(number, settings) for number in range(len(plan)))
    if fitted < MINIMUM_POINTS:
        raise ConfigurationError(
            f"touch: {len(plan)} points with every {settings.hold_out}th held out leave"
            f" {fitted}; at least {MINIMUM_POINTS} are fitted; ask for more"
        )


def held_out(number: int, settings: TouchSettings) -> bool:
    """Whether the point with this `number` is kept out of the fit of the map, to judge
    it by.
    """
    return number % settings.hold_out == settings.hold_out // 2


@dataclass(frozen=True, slots=True, eq=False)
class TouchedPoint:
    """Point that the arm has touched: where the arm was, in metres, and where an image
    showed the pointer, in pixels.

    `number` of the pose, `position` (2,) x, z [m] of the arm, `pixel` (2,) u, v of the
    disc in the raw image; `again` marks a second touch of the same pose.
    """

    number: int
    position: Array
    pixel: Array
    held_out: bool
    again: bool = False


@dataclass(frozen=True, slots=True)
class TouchFit(PlaneMap):
    """Map from the image to the plane, fitted to the touches in `used`, with all other
    touches sorted into groups.

    `validation` are held-out touches, `outliers` all outliers, `repeated_outliers`
    those of them whose second touch has the same error, `replaced` first touches that a
    second one replaced.
    """

    used: tuple[TouchedPoint, ...]
    validation: tuple[TouchedPoint, ...] = ()
    outliers: tuple[TouchedPoint, ...] = ()
    repeated_outliers: tuple[TouchedPoint, ...] = ()
    replaced: tuple[TouchedPoint, ...] = ()

    def error(self, touched: TouchedPoint) -> Array:
        """Error [m], of shape (2,), of a touched point along x and z: its position by
        the map minus that of the arm.
        """
        residual: Array = self.to_plane(touched.pixel)[0] - touched.position
        return residual

    def describe(self, points: Sequence[TouchedPoint]) -> dict[int, str]:
        """Texts on touched `points`, by their numbers, with the position of the arm and
        the error in the image [px].
        """
        texts = {}
        for point in sorted(points, key=lambda p: p.number):
            mapped = self.homography.to_image(point.position)[0]
            error = lengths(mapped - self.lens.undistort(point.pixel)[0])
            x, z = point.position
            words = f"point {point.number} at x {x:.3f}, z {z:.3f} m"
            texts[point.number] = f"{words} is {error:.1f} px off"
        return texts


def fit_touches(
    touches: Sequence[TouchedPoint], lens: Lens, settings: TouchSettings
) -> TouchFit:
    """Fit a map from the image to the plane, in spite of outliers, to the newest touch
    of each pose, and sort all other touches.

    Held-out poses are not fitted. The order of `touches` does not matter. Raises
    ConfigurationError where they give no map.
    """
    by_number = {
        p.number: p for p in sorted(touches, key=lambda p: (p.number, p.again))
    }
    newest = sorted(by_number.values(), key=lambda p: (*p.position, p.number))
    fitted = [p for p in newest if not p.held_out]
    homography, inliers = fit_homography(
        lens.undistort(np.reshape([p.pixel for p in fitted], (-1, 2))),
        np.reshape([p.position for p in fitted], (-1, 2)),
    )
    fit = TouchFit(lens, homography, tuple(compress(fitted, inliers)))
    return _sort_others(fit, touches, newest, settings)


def _sort_others(
    fit: TouchFit,
    touches: Sequence[TouchedPoint],
    newest: Sequence[TouchedPoint],
    settings: TouchSettings,
) -> TouchFit:
    """Copy of `fit` in which all touches that were not fitted are sorted into those
    that judge the map, outliers and replaced ones.

    A second touch with the first one's error shows that the map is wrong there; one
    that is off in another way says nothing, and does not judge the map.
    """
    firsts = {p.number: p for p in touches if not p.again}
    worst = 1e-3 * settings.worst_mm  # m

    def is_off(touch: TouchedPoint) -> bool:
        if touch.held_out:
            return bool(lengths(fit.error(touch)) > worst)
        return touch not in fit.used

    off = list(filter(is_off, newest))
    twice = {p: firsts[p.number] for p in newest if p.again and p.number in firsts}
    alike = [p for p in twice if lengths(fit.error(p) - fit.error(twice[p])) < worst]
    judging = [p for p in newest if p in alike or p not in off or not p.again]
    return replace(
        fit,
        validation=tuple(p for p in judging if p.held_out),
        outliers=tuple(off),
        repeated_outliers=tuple(p for p in off if p in alike),
        replaced=tuple(first for p, first in twice.items() if p not in off),
    )


def suspects(
    touches: Sequence[TouchedPoint], lens: Lens, settings: TouchSettings
) -> tuple[int, ...]:
    """Numbers of the points that do not agree with the map fitted to `touches`, and
    that should be touched again.
    """
    try:
        fit = fit_touches(touches, lens, settings)
    except ConfigurationError:
        return ()
    return tuple(sorted(p.number for p in fit.outliers))


FEWEST_TOUCHES = 3  # on either side of a move, that it explains
LOSS_SCALE = 0.3  # px, error from which a touch counts less, as it may be an outlier
INLIER_SIGMA = 5.0  # of the errors that count
LEAST_SIGMA = 1e-6  # px, under which none is
MAP_NUMBERS = 8  # free numbers of a homography
UNKNOWNS = 10  # with a shift of the image
# sigma by which a move is significant; Source: study mishaps
MOVE_SIGMA = 3.8


@dataclass(frozen=True, slots=True)
class Move:
    """Turn of the camera by `mrad` [mrad] after the point with the number `after`,
    which shifts later points by `shift_mm` [mm].
    """

    after: int
    shift_mm: float
    mrad: float


def camera_move(
    touches: Sequence[TouchedPoint], lens: Lens, homography: Homography, least_mm: float
) -> Move | None:
    """Move of the camera, between two touches, that explains the errors of `touches`
    best; None where none does by at least `least_mm` [mm].

    For each moment, a map and a shift of the image from then on are fitted robustly
    (Cauchy loss) to all touches, wild ones too. `homography` is where the fit begins.
    """
    ordered = sorted(touches, key=lambda touched: (touched.again, touched.number))
    positions = np.array([touched.position for touched in ordered])
    pixels = lens.undistort(np.array([touched.pixel for touched in ordered]))
    moments = range(FEWEST_TOUCHES, len(ordered) - FEWEST_TOUCHES + 1)
    if not moments:
        return None

    fits = {n: _fit_move(positions, pixels, n, homography) for n in moments}
    moment = min(fits, key=lambda n: fits[n][0])
    _, shift, sigma = fits[moment]

    # the shift in the middle of the points
    middle = homography.to_image(positions.mean(axis=0)[None])[0]
    before, after = homography.to_plane(np.array([middle, middle + shift]))
    shift_mm = 1e3 * float(lengths(after - before))
    shift_px = float(lengths(shift))
    if shift_mm < least_mm or shift_px < MOVE_SIGMA * sigma:
        return None
    mrad = 1e3 * shift_px / lens.matrix[0, 0]
    return Move(ordered[moment - 1].number, shift_mm, mrad)


def _fit_move(
    positions: Array, pixels: Array, moment: int, begin: Homography
) -> tuple[float, Array, float]:
    """Fit a map from the plane to the image, together with a shift of the image from
    touch number `moment` on, in spite of outliers.

    `positions` (n, 2) [m] are those of the arm and `pixels` (n, 2) [px] undistorted.
    Returns its cost, the shift (2,) [px] and the largest sigma of the shift [px];
    cost and sigma are infinite where it explains too few touches on either side.
    """
    from scipy.optimize import least_squares

    later = (np.arange(len(positions)) >= moment)[:, None]

    def errors(unknown: Array) -> Array:
        matrix = np.append(unknown[:MAP_NUMBERS], 1.0).reshape(3, 3)
        moved = transform(matrix, positions) + later * unknown[MAP_NUMBERS:]
        return (moved - pixels).ravel()

    matrix = begin.inverse / begin.inverse[2, 2]
    misses = pixels - begin.to_image(positions)
    shift = np.median(misses[moment:], axis=0)
    start = np.append(matrix.ravel()[:MAP_NUMBERS], shift)
    solution = least_squares(
        errors, start, loss="cauchy", f_scale=LOSS_SCALE, x_scale="jac"
    )

    remaining = errors(solution.x)
    count = len(remaining)
    share = count / (count - UNKNOWNS)
    sigma = max(robust_sigma(remaining), LEAST_SIGMA) * np.sqrt(share)
    used = np.abs(remaining) < INLIER_SIGMA * sigma
    sides = np.split(used.reshape(-1, 2).all(axis=1), [moment])
    if min(map(np.sum, sides)) < FEWEST_TOUCHES:
        return np.inf, shift, np.inf
    slopes = solution.jac[used]
    covariance = sigma**2 * np.linalg.pinv(slopes.T @ slopes)
    of_shift = covariance[MAP_NUMBERS:, MAP_NUMBERS:]
    shift_sigma = float(np.sqrt(np.linalg.eigvalsh(of_shift)[-1]))
    return float(solution.cost), solution.x[MAP_NUMBERS:], shift_sigma
