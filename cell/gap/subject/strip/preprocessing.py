"""Smooths measured gripper paths, and thins the midline points of images."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from cell.record.columns import Profile
from drivers.base.geometry import interpolate_columns, lengths
from drivers.base.types import Array, frozen

SMOOTHING_STEP = 0.005  # s between the points that are smoothed
DRIVING_STEP = 0.0025  # s between the points that drive the model
NARROWEST_HALF, WIDEST_HALF = 5, 20  # points on each side of the parabola that smooths
QUIET_NOISE = 5e-5  # m of noise up to which the narrow parabola serves
# s between images that are compared: nearer ones add no information
IMAGE_INTERVAL = 0.045
CURVE_POINTS = 40  # of one image that are compared
MEDIAN_WINDOW = 7  # points of the running median
# standard deviations from the median, beyond the points' spacing, that make a point an
# outlier
OUTLIER_SIGMAS = 6.0
FEWEST_POINTS = 5  # points of an image that is used


def smooth_path(t: Array, poses: Array, sigma: float) -> tuple[Array, Array]:
    """Smoothed gripper path, as even times [s] of shape (k,) and poses of shape (k, 3),
    from `poses` measured at times `t` [s] with noise `sigma` [m].

    A parabola through the points near each moment (Savitzky and Golay 1964); the more
    noise, the more points. A servo's limited jerk bends a path too little for the
    narrow one to blunt it.
    """
    even = np.arange(t[0], t[-1] + 0.5 * SMOOTHING_STEP, SMOOTHING_STEP)
    rough = interpolate_columns(even, t, poses)
    noisy = NARROWEST_HALF * (sigma / QUIET_NOISE) ** 0.4
    half = int(np.clip(noisy, NARROWEST_HALF, WIDEST_HALF))
    half = min(half, (len(even) - 1) // 2)
    smooth = _parabolic_smoothing(rough, half) if half > 1 else rough
    fine = np.arange(even[0], even[-1] + 0.5 * DRIVING_STEP, DRIVING_STEP)
    return frozen(fine), frozen(CubicSpline(even, smooth)(fine))


def _parabolic_smoothing(values: Array, half: int) -> Array:
    """Copy of the columns of `values`, each smoothed by local parabolas through `half`
    neighbours on either side of each row.

    The first and last parabolas serve the ends, too. Importing scipy.signal would take
    a second.
    """
    powers = np.vander(np.arange(-half, half + 1.0), 3, increasing=True)
    through = np.linalg.pinv(powers)
    count = len(powers)
    windows = sliding_window_view(values, count, axis=0)
    ends = values[:count], values[-count:]
    first, last = (powers @ (through @ part) for part in ends)
    return np.concatenate([first[:half], windows @ through[0], last[half + 1 :]])


class Midlines(NamedTuple):
    """Points on the midline of a strip in several camera images, listed one image after
    another, with the time of each image in `stamps` [s].

    Of each of the n points: `points` (n, 2) in x and z [m], `image` (n,) its image's
    index, `s` (n,) [m] its approximate arc length from the fixed edge, counted back
    from the gripper.
    """

    stamps: Array
    points: Array
    image: NDArray[np.int64]
    s: Array

    @classmethod
    def of(
        cls, stamps: Sequence[float], curves: Sequence[Array], places: Sequence[Array]
    ) -> Self:
        """Midlines of images taken at times `stamps` [s], from one curve of points [m]
        for each image and the arc lengths [m] of these points in `places`.
        """
        counts = [len(curve) for curve in curves]
        image = np.repeat(np.arange(len(counts)), np.array(counts, dtype=np.int64))
        points = np.concatenate([np.empty((0, 2)), *curves])  # of no image, too
        s = np.concatenate([[], *places])
        return cls(
            stamps=frozen(stamps), points=frozen(points), image=image, s=frozen(s)
        )


def images_of(profile: Profile, grip: Array, length: float, sigma: float) -> Midlines:
    """Midline points of a measured `profile` that are compared with a simulation, image
    by image, thinned and without outliers.

    `grip` (n, 2) [m] is the gripper's position at each of the profile's points.
    """
    stamps: list[float] = []
    points: list[Array] = []
    places: list[Array] = []
    row = 0
    last_stamp = -np.inf

    for stamp, curve in profile.curves():
        gripper = grip[row]
        row += len(curve)
        if stamp < last_stamp + IMAGE_INTERVAL:
            continue

        inliers = curve[_inlier_mask(curve, sigma)]
        if len(inliers) < FEWEST_POINTS:
            continue

        to_gripper = np.hypot(*np.diff(inliers.T, append=gripper[:, None]))
        s = length - np.cumsum(to_gripper[::-1])[::-1]
        last = len(inliers) - 1
        chosen = np.unique(np.linspace(0, last, CURVE_POINTS).round().astype(np.int64))
        points.append(inliers[chosen])
        places.append(s[chosen])
        stamps.append(stamp)
        last_stamp = stamp

    return Midlines.of(stamps, points, places)


def _inlier_mask(curve: Array, sigma: float) -> NDArray[np.bool_]:
    """Mask that is true for those points of a `curve` [m] that lie near its running
    median, and so are no outliers.
    """
    if len(curve) <= MEDIAN_WINDOW:
        return np.ones(len(curve), dtype=bool)
    off = lengths(curve - _running_median(curve))
    spacing = np.median(lengths(np.diff(curve, axis=0)))
    near: NDArray[np.bool_] = off < OUTLIER_SIGMAS * sigma + spacing
    return near


def _running_median(curve: Array) -> Array:
    """Running median of the points of a `curve` [m], continued linearly beyond its two
    ends.
    """
    half = MEDIAN_WINDOW // 2
    inner = np.median(sliding_window_view(curve, MEDIAN_WINDOW, axis=0), axis=-1)
    reach = min(half, len(inner) - 1)
    first = inner[0]
    last = inner[-1]
    ahead = np.arange(1, half + 1)[:, None]
    before = first - ahead[::-1] * (inner[reach] - first) / reach
    after = last + ahead * (last - inner[-1 - reach]) / reach
    return np.concatenate([before, inner, after])
