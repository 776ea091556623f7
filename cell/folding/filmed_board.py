"""Calibration of a film's camera by a printed board that first stands in the strip's
plane.

The board gives lens and plane; the strip's own ends and its line on the desk give its
place.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import theilslopes

from calibration.board import BoardSettings, BoardView, find_board
from calibration.calibration import Calibration, change_calibration, make_calibration
from calibration.homography import Homography, fit_homography
from calibration.lens import fit_lens
from cell.perception.held_end import FINE, colour_edge, find_end
from cell.perception.resting_strip import sample_plane
from cell.perception.scene import colour_distances
from drivers.base.errors import ConfigurationError, in_mm
from drivers.base.types import Array, Frame, Image
from drivers.strip.file import StripFile

PERIOD = 0.09  # s between images that are searched for the board
PATIENCE = 4.0  # s within which the board must appear, and the scene be still after it
SAME_PLACE = 1.0  # px by which a standing board may seem to move
FEWEST_STANDING, FEWEST_TILTED = 4, 2  # views of the board
# grey levels, and share of pixels that may differ by more
STILL_LEVEL, STILL_SHARE = 14, 0.002
NEVER_STILL = (
    f"the scene is never still within {PATIENCE:g} s after the board is last seen; take"
    " it away, wait a second there with the clip held still, then fold"
)
NO_BOARD = (
    f"the printed board is not seen in the first {PATIENCE:g} s, at least {{}} of its"
    " corners must be; stand it upright in the plane of the strip's edge, in full"
    " view, in light that does not mirror in it"
)
SMALL = (480, 270)  # px at which images are compared
FIXED = cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_ZERO_TANGENT_DIST
# few views of a phone's lens do not tell these
FIXED |= cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
RASTER = 0.001  # m, at which the strip is searched in the plane
# standard deviations of its colour, tried one after the other
LIMITS = (3.0, 6.0, 12.0)
ALIKE = 0.1  # share of the stated length by which a piece of its colour may differ
SLIM = 0.2  # of its length, apparent height of a strip at most
# m, rms of curves in a plane by a board (47 rendered films)
PLANE_ERROR = 0.001
PRINTED = 0.02  # allowed relative difference of the strip's length by the board
ROUNDS = 3  # iterations of finding the ends and correcting the map
PROBE = 0.008  # m, search range about the lower border
# share of the length beside an end in which its border counts: lenses bend it
NEAR_END = 0.35
WITHIN, BEYOND = 0.06, 0.04  # m: search range about an end, inwards and outwards


def calibrate_film(
    film: Path, frames: Iterator[Frame], boards: BoardSettings, strip: StripFile
) -> tuple[Calibration, float]:
    """Calibrate the camera of a film by the printed board in its first images; returns
    the calibration, and the time [s] from which nothing moves.

    Raises ConfigurationError that names what the film at `film` does not show: the
    board, a still scene after it, the strip, its ends.
    """
    views, first = _views_until_still(film, frames, boards)
    calibration = _calibrate_by_board(film, views, boards, first.image.shape)
    return _aligned(film, first.image, calibration, strip), first.stamp


def _views_until_still(
    film: Path, frames: Iterator[Frame], boards: BoardSettings
) -> tuple[list[BoardView], Frame]:
    """Views of the board at the begin of a film, and the first image after the board is
    gone in which nothing moves.
    """
    board = boards.board()
    detector = cv2.aruco.CharucoDetector(board)
    views: list[BoardView] = []
    before: Image | None = None
    last_seen = 0.0  # s, stamp of the last image with a part of the board
    due = 0.0
    for frame in frames:
        if frame.stamp < due:
            continue

        due = frame.stamp + PERIOD
        seen = find_board(frame.image, detector, board)
        if seen.view is not None and seen.corners >= boards.corners:
            views.append(seen.view)

        small = cv2.resize(frame.image, SMALL, interpolation=cv2.INTER_AREA)
        if seen.markers:
            last_seen = frame.stamp
        elif views and before is not None and _is_still(before, small):
            return views, frame

        if frame.stamp > last_seen + PATIENCE:
            break

        before = small

    raise ConfigurationError(
        f"{film}: {NEVER_STILL if views else NO_BOARD.format(boards.corners)}"
    )


def _is_still(before: Image, after: Image) -> bool:
    """Whether two successive images show the same scene except for noise."""
    changed = cv2.absdiff(after, before).max(axis=2) > STILL_LEVEL
    return bool(changed.mean() < STILL_SHARE)


def _calibrate_by_board(
    film: Path, views: list[BoardView], boards: BoardSettings, shape: tuple[int, ...]
) -> Calibration:
    """Calibration of a film's camera to the plane of the standing board, where x runs
    to the right and z up from the board's upper left corner.
    """
    standing = [view for view in views if view.distance(views[0]) < SAME_PLACE]
    tilted = [view for view in views if view.distance(views[0]) >= SAME_PLACE]
    if len(standing) < FEWEST_STANDING or len(tilted) < FEWEST_TILTED:
        raise ConfigurationError(
            f"{film}: the board stands still in {len(standing)} images and moves in"
            f" {len(tilted)}, at least {FEWEST_STANDING} and {FEWEST_TILTED} are"
            " needed; let it stand for a second as the film begins, then tilt it"
            " slowly as you take it away"
        )

    board = np.vstack([view.board for view in standing])
    image = np.vstack([view.image for view in standing])
    on_board = [board, *(view.board for view in tilted)]
    in_image = [image, *(view.image for view in tilted)]
    fit = fit_lens(on_board, in_image, (shape[1], shape[0]), FIXED)
    deviation = fit.focal_deviation / fit.lens.matrix[0, 0]
    if not deviation <= boards.focal:
        raise ConfigurationError(
            f"{film}: the board gives the focal length within {1e2 * deviation:.1f} %,"
            f" {1e2 * boards.focal:g} % are needed; tilt it further as you take it"
            " away, slowly"
        )

    upright = board[:, :2] * (1, -1)  # the board's y is down
    pixels = fit.lens.undistort(image)
    plane, _ = fit_homography(pixels, upright)
    misses = np.hypot(*(plane.to_plane(pixels) - upright).T)  # m
    residual = PLANE_ERROR + float(misses.mean())
    camera = f"film {film.name}"
    return make_calibration(
        fit.lens, plane, residual_mm=1e3 * residual, date="", camera=camera
    )


def _aligned(
    film: Path, image: Image, calibration: Calibration, strip: StripFile
) -> Calibration:
    """Copy of `calibration`, moved and turned in its plane so that the strip in `image`
    lies from x = 0 to x = its length.

    Clamp and clip hide about as much of one end as of the other: the middle is kept.
    """
    seen = _find_strip(film, image, calibration, strip)
    for _ in range(ROUNDS):
        calibration = _with_axis(calibration, seen, seen.length)
        seen = _find_ends(image, calibration, seen, strip.thickness)
    length = seen.length
    if not abs(length / strip.length - 1) <= PRINTED:
        raise ConfigurationError(
            f"{film}: the strip is {in_mm(length)} long by the board, its file"
            f" says {in_mm(strip.length)}, allowed within {1e2 * PRINTED:g} %;"
            " print the board at 100 %, stand it in the plane of the strip's edge, and"
            " measure the strip from its clamp to its clip, both of which need colours"
            " of their own"
        )
    return _with_axis(calibration, seen, strip.length)


class _SeenStrip(NamedTuple):
    """Strip as an image shows it: its left and its right end in the plane of the
    calibration board [m], and its colour.
    """

    left: Array
    right: Array
    colour: Array

    @property
    def length(self) -> float:
        """Distance [m] between the left and the right end of the strip."""
        return float(np.hypot(*(self.right - self.left)))


def _with_axis(
    calibration: Calibration, seen: _SeenStrip, length: float
) -> Calibration:
    """Copy of `calibration` whose x axis runs along the `seen` strip, with the strip's
    middle at x = `length` / 2 [m].
    """
    along = (seen.right - seen.left) / seen.length
    turn = np.array([(along[0], along[1]), (-along[1], along[0])])
    move = np.eye(3)
    move[:2, :2] = turn
    move[:2, 2] = (length / 2, 0.0) - turn @ (seen.left + seen.right) / 2
    homography = Homography.from_matrix(move @ calibration.homography.matrix)
    return change_calibration(calibration, homography=homography)


def _find_strip(
    film: Path, image: Image, calibration: Calibration, strip: StripFile
) -> _SeenStrip:
    """Rough position of the strip in `image`: the slim piece of uniform colour whose
    length is nearest to that of the strip's file.
    """
    height, width = image.shape[:2]
    corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)]) * (width - 1, height - 1)
    rim = calibration.to_plane(corners)
    ends = zip(rim.min(axis=0), rim.max(axis=0), strict=True)
    x, z = (np.arange(low, high, RASTER) for low, high in ends)
    plane = sample_plane(image, calibration, np.stack(np.meshgrid(x, z), axis=-1))

    stated = np.array([strip.colour[::-1]], dtype=np.float64)  # BGR
    distances = colour_distances(plane, stated)[..., 0]
    for limit in LIMITS:
        labels, lengths = _slim_pieces(distances < limit)
        best = int(np.argmin(np.abs(lengths - strip.length)))
        if abs(lengths[best] / strip.length - 1) < ALIKE:
            v, u = np.nonzero(labels == best)
            line = np.polynomial.Polynomial.fit(x[u], z[v], 1)
            first = x[u.min()]
            last = x[u.max()]
            left = np.array([first, line(first)])
            right = np.array([last, line(last)])
            return _SeenStrip(left, right, np.median(plane[v, u], axis=0))
    raise ConfigurationError(
        f"{film}: no strip of {in_mm(strip.length)} and of the colour"
        f" {list(strip.colour)} lies in the plane of the board, the nearest piece is"
        f" {in_mm(lengths[best])}; lay it straight with both ends in view, or"
        " correct `length` or `colour` in the strip's file"
    )


def _slim_pieces(alike: NDArray[np.bool_]) -> tuple[NDArray[np.int32], Array]:
    """Number of the connected piece at each point of the mask `alike`, and the length
    [m] of each piece, 0 for one that is not SLIM.

    A cell of the mask is RASTER wide.
    """
    mask = cv2.morphologyEx(alike.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 9)))
    _, labels, pieces, _ = cv2.connectedComponentsWithStats(mask)
    widths, heights = pieces[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].T
    lengths = np.where(heights < SLIM * widths, np.hypot(widths, heights) * RASTER, 0.0)
    return labels, lengths


def _find_ends(
    image: Image, calibration: Calibration, seen: _SeenStrip, thickness: float
) -> _SeenStrip:
    """Copy of `seen` with precise positions of both ends, for a strip that rests along
    the x axis from x = 0 on.

    The strip's lower border is sampled, then its ends are searched. `thickness` [m] is
    that of the strip.
    """
    length = seen.length
    x = np.linspace(0.06, 0.94, 120) * length
    down = np.arange(PROBE, -PROBE, -FINE)
    probed = np.stack(np.broadcast_arrays(x[:, None], down), -1)
    rows = sample_plane(image, calibration, probed)
    border = PROBE - FINE * np.array([colour_edge(row, seen.colour) for row in rows])

    ends = []
    for end, outward in ((0.0, -1.0), (length, 1.0)):
        near = np.isfinite(border) & (np.abs(x - end) < NEAR_END * length)
        slope = start = 0.0
        if near.any():
            slope, start, *_ = theilslopes(border[near], x[near])

        along = end + outward * np.arange(-WITHIN, BEYOND, FINE)
        # the midline
        line = np.column_stack([along, start + slope * along + thickness / 2])
        distance = find_end(image, calibration, thickness, line)
        x_end = end if np.isnan(distance) else along[0] + outward * distance
        ends.append(np.array([x_end, start + slope * x_end + thickness / 2]))
    return seen._replace(left=ends[0], right=ends[1])
