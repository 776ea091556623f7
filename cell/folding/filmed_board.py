"""Calibration of a film's camera by a printed board that first stands in the strip's plane.

The board gives lens and plane; the strip's own ends and its line on the desk give its place.
"""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from scipy.stats import theilslopes

from calibration.board import BoardSettings, BoardView, find_board
from calibration.calibration import Calibration, change_calibration, make_calibration
from calibration.homography import Homography, fit_homography
from calibration.lens import fit_lens
from cell.perception.held_end import FINE, colour_edge, find_end
from cell.perception.resting_strip import sample_plane
from cell.perception.scene import colour_distances
from drivers.errors import ConfigurationError
from drivers.strip.file import StripFile
from drivers.types import Array, Frame, Image

PERIOD = 0.09  # s between images that are searched for the board
PATIENCE = 4.0  # s within which the board must appear, and the scene be still after it
SAME_PLACE = 1.0  # px by which a standing board may seem to move
FEWEST_STANDING, FEWEST_TILTED = 4, 2  # views of the board
STILL_LEVEL, STILL_SHARE = 14, 0.002  # grey levels, and share of pixels that may differ by more
NEVER_STILL = (
    f"the scene is never still within {PATIENCE:g} s after the board is last seen; take it away, "
    "wait a second there with the clip held still, then fold"
)
NO_BOARD = (
    f"the printed board is not seen in the first {PATIENCE:g} s, at least {{}} of its corners must "
    "be; stand it upright in the plane of the strip's edge, in full view, in light that does not "
    "mirror in it"
)
SMALL = (480, 270)  # px at which images are compared
FIXED = cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST
FIXED |= cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3  # few views of a phone's lens do not tell these
RASTER = 0.001  # m, at which the strip is searched in the plane
LIMITS = (3.0, 6.0, 12.0)  # standard deviations of its colour, tried one after the other
ALIKE = 0.1  # share of the stated length by which a piece of its colour may differ
SLIM = 0.2  # of its length, apparent height of a strip at most
PLANE_ERROR = 0.001  # m, rms of curves in a plane by a board (python -m tests.lab measure-phone)
PRINTED = 0.02  # allowed relative difference of the strip's length by the board
ROUNDS = 3  # iterations of finding the ends and correcting the map
PROBE = 0.008  # m, search range about the lower border
NEAR_END = 0.35  # share of the length beside an end in which its border counts: lenses bend it
WITHIN, BEYOND = 0.06, 0.04  # m: search range about an end, inwards and outwards


def calibrate_film(
    film: Path, frames: Iterator[Frame], boards: BoardSettings, strip: StripFile
) -> tuple[Calibration, float]:
    """Calibrate by the first seconds of `frames`; also returns when [s] the strip lies still.

    Raises ConfigurationError that names what the film at `film` does not show: the board, a still
    scene after it, the strip, its ends.
    """
    views, first = _views_until_still(film, frames, boards)
    calibration = _calibrate_by_board(film, views, boards, first.image.shape)
    return _aligned(film, first.image, calibration, strip), first.stamp


def _views_until_still(
    film: Path, frames: Iterator[Frame], boards: BoardSettings
) -> tuple[list[BoardView], Frame]:
    """Views of the board, and the first image after the board in which nothing moves."""
    board = boards.board()
    detector = cv2.aruco.CharucoDetector(board)
    views, before, board_gone, due = list[BoardView](), None, 0.0, 0.0
    for frame in frames:
        if frame.stamp < due:
            continue
        due = frame.stamp + PERIOD
        seen = find_board(frame.image, detector, board)
        if seen.view is not None and seen.corners >= boards.corners:
            views.append(seen.view)
        small = cv2.resize(frame.image, SMALL, interpolation=cv2.INTER_AREA)
        if seen.markers:
            board_gone = frame.stamp
        elif views and before is not None and _is_still(before, small):
            return views, frame
        if frame.stamp > board_gone + PATIENCE:
            break
        before = small
    raise ConfigurationError(f"{film}: {NEVER_STILL if views else NO_BOARD.format(boards.corners)}")


def _is_still(before: Image, after: Image) -> bool:
    """Whether two images (h, w, 3) in succession show the same scene but for noise."""
    changed = cv2.absdiff(after, before).max(axis=2) > STILL_LEVEL
    return bool(changed.mean() < STILL_SHARE)


def _calibrate_by_board(
    film: Path, views: list[BoardView], boards: BoardSettings, shape: tuple[int, ...]
) -> Calibration:
    """Calibration to the standing board's plane: x right and z up from its upper left corner."""
    standing = [view for view in views if view.distance(views[0]) < SAME_PLACE]
    tilted = [view for view in views if view.distance(views[0]) >= SAME_PLACE]
    if len(standing) < FEWEST_STANDING or len(tilted) < FEWEST_TILTED:
        raise ConfigurationError(
            f"{film}: the board stands still in {len(standing)} images and moves in {len(tilted)}, "
            f"at least {FEWEST_STANDING} and {FEWEST_TILTED} are needed; let it stand for a second "
            "as the film begins, then tilt it slowly as you take it away"
        )
    board, seen = (np.vstack([getattr(v, part) for v in standing]) for part in ("board", "image"))
    on_board, in_image = [board, *(v.board for v in tilted)], [seen, *(v.image for v in tilted)]
    fit = fit_lens(on_board, in_image, (shape[1], shape[0]), FIXED)
    deviation = fit.focal_deviation / fit.lens.matrix[0, 0]
    if not deviation <= boards.focal:
        raise ConfigurationError(
            f"{film}: the board gives the focal length within {1e2 * deviation:.1f} %, "
            f"{1e2 * boards.focal:g} % are needed; tilt it further as you take it away, slowly"
        )
    upright, ideal = board[:, :2] * (1, -1), fit.lens.undistort(seen)  # the board's y is down
    plane, _ = fit_homography(ideal, upright)
    off = PLANE_ERROR + float(np.hypot(*(plane.to_plane(ideal) - upright).T).mean())
    facts = {"residual_mm": 1e3 * off, "date": "", "camera": f"film {film.name}"}
    return make_calibration(fit.lens, plane, **facts)


def _aligned(film: Path, image: Image, calibration: Calibration, strip: StripFile) -> Calibration:
    """Calibration moved and turned so that the strip lies from x = 0 to its length.

    Clamp and clip hide about as much of one end as of the other: the middle is kept.
    """
    left, right, colour = _find_strip(film, image, calibration, strip)
    for _ in range(ROUNDS):
        length = float(np.hypot(*(right - left)))
        calibration = _with_axis(calibration, left, right, length)
        left, right = _find_ends(image, calibration, length, strip, colour)
    length = float(np.hypot(*(right - left)))
    if not abs(length / strip.length - 1) <= PRINTED:
        raise ConfigurationError(
            f"{film}: the strip is {1e3 * length:.0f} mm long by the board, its file says "
            f"{1e3 * strip.length:.0f} mm, allowed within {1e2 * PRINTED:g} %; print the board "
            "at 100 %, stand it in the plane of the strip's edge, and measure the strip from "
            "its clamp to its clip, both of which need colours of their own"
        )
    return _with_axis(calibration, left, right, strip.length)


def _with_axis(calibration: Calibration, left: Array, right: Array, length: float) -> Calibration:
    """Calibration whose x axis runs from `left` to `right` (2,) [m], the middle at `length` / 2."""
    along = (right - left) / np.hypot(*(right - left))
    turn = np.array([(along[0], along[1]), (-along[1], along[0])])
    move = np.eye(3)
    move[:2, :2], move[:2, 2] = turn, (length / 2, 0.0) - turn @ (left + right) / 2
    homography = Homography.from_matrix(move @ calibration.homography.matrix)
    return change_calibration(calibration, homography=homography)


def _find_strip(
    film: Path, image: Image, calibration: Calibration, strip: StripFile
) -> tuple[Array, Array, Array]:
    """Left and right end (2,) [m] of the piece of the strip's colour, roughly, and its colour."""
    height, width = image.shape[:2]
    rim = calibration.to_plane(np.array([(0, 0), (1, 0), (0, 1), (1, 1)]) * (width - 1, height - 1))
    x, z = (np.arange(*ends, RASTER) for ends in zip(rim.min(axis=0), rim.max(axis=0), strict=True))
    plane = sample_plane(image, calibration, np.stack(np.meshgrid(x, z), axis=-1))
    away = colour_distances(plane.reshape(-1, 3), np.array([strip.colour[::-1]], dtype=np.float64))
    for limit in LIMITS:
        mask = (away < limit).reshape(plane.shape[:2]).astype(np.uint8)
        mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 9)))
        _, labels, pieces, _ = cv2.connectedComponentsWithStats(mask)
        wide, high = pieces[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].T
        lengths = np.where(high < SLIM * wide, np.hypot(wide, high) * RASTER, 0.0)
        best = int(np.argmin(np.abs(lengths - strip.length)))
        if abs(lengths[best] / strip.length - 1) < ALIKE:
            v, u = np.nonzero(labels == best)
            line = np.polynomial.Polynomial.fit(x[u], z[v], 1)
            left, right = (np.array([end, line(end)]) for end in (x[u.min()], x[u.max()]))
            return left, right, np.median(plane[v, u], axis=0)
    raise ConfigurationError(
        f"{film}: no strip of {1e3 * strip.length:.0f} mm and of the colour {list(strip.colour)} "
        f"lies in the plane of the board, the nearest piece is {1e3 * lengths[best]:.0f} mm; lay "
        "it straight with both ends in view, or correct `length` or `colour` in the strip's file"
    )


def _find_ends(
    image: Image, calibration: Calibration, length: float, strip: StripFile, colour: Array
) -> tuple[Array, Array]:
    """Both ends (2,) [m] of the resting midline, where a strip of a `colour` (3,) lies nearly.

    `length` [m] is how long it appears. Its lower border is sampled, then its ends are searched.
    """
    x = np.linspace(0.06, 0.94, 120) * length
    down = np.arange(PROBE, -PROBE, -FINE)
    rows = sample_plane(image, calibration, np.stack(np.broadcast_arrays(x[:, None], down), -1))
    low = PROBE - FINE * np.array([colour_edge(row, colour) for row in rows])
    ends = []
    for end, outward in ((0.0, -1.0), (length, 1.0)):
        seen = np.isfinite(low) & (np.abs(x - end) < NEAR_END * length)
        slope, start = theilslopes(low[seen], x[seen])[:2] if seen.any() else (0.0, 0.0)
        along = end + outward * np.arange(-WITHIN, BEYOND, FINE)
        line = np.column_stack([along, start + slope * along + strip.thickness / 2])
        place = find_end(image, calibration, strip.thickness, line)
        x_end = end if np.isnan(place) else along[0] + outward * place
        ends.append(np.array([x_end, start + slope * x_end + strip.thickness / 2]))
    return ends[0], ends[1]
