"""Images of the visible midline as unlabelled points, outliers removed, thinned."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cell.record.columns import Profile
from drivers.types import Array, frozen

IMAGE_INTERVAL = 0.045  # s between images that are compared: nearer ones say the same again
CURVE_POINTS = 40  # of one image that are compared
MEDIAN_WINDOW = 7  # points of the running median from which wild ones stand out
# standard deviations from it, and the distance between points, that make one wild
OUTLIER_SIGMAS = 6.0
FEWEST_POINTS = 5  # points of an image that is used


@dataclass(frozen=True, slots=True)
class Images:
    """`stamps` (m,) [s]; `points` (n, 2) [m] of all images, `image` (n,) which one each is of;
    `s` (n,) [m] about how far along the strip it lies, counted back from the gripper.
    """

    stamps: Array
    points: Array
    image: NDArray[np.int64]
    s: Array


def images_of(
    profile: Profile, grip: Array, length: float, sigma: float, *, empty: bool = False
) -> Images:
    """The images of `profile`; `grip` (n, 2) [m] is where the gripper was at each of its points."""
    stamps: list[float] = []
    points: list[Array] = []
    places: list[Array] = []
    at, last = 0, -np.inf
    for stamp, curve in [] if empty else profile.curves():
        gripper, at = grip[at], at + len(curve)
        if stamp < last + IMAGE_INTERVAL:
            continue
        kept = curve[believable(curve, sigma)]
        if len(kept) < FEWEST_POINTS:
            continue
        s = length - _to_grip(kept, gripper)
        chosen = np.unique(np.linspace(0, len(kept) - 1, CURVE_POINTS).round().astype(np.int64))
        points.append(kept[chosen])
        places.append(s[chosen])
        stamps.append(stamp)
        last = stamp
    counts = np.array([len(p) for p in points], dtype=np.int64)
    return Images(
        frozen(stamps),
        frozen(np.concatenate(points) if points else np.empty((0, 2))),
        np.repeat(np.arange(len(points)), counts),
        frozen(np.concatenate(places) if places else []),
    )


def believable(curve: Array, sigma: float) -> NDArray[np.bool_]:
    """Which points (n,) of a curve (n, 2) lie near the running median of their neighbours."""
    if len(curve) <= MEDIAN_WINDOW:
        return np.ones(len(curve), dtype=bool)
    off = np.hypot(*(curve - running_median(curve)).T)
    spacing = float(np.median(np.hypot(*np.diff(curve, axis=0).T)))
    return np.asarray(off < OUTLIER_SIGMAS * sigma + spacing)


def running_median(curve: Array) -> Array:
    """Medians (n, 2) over a window of MEDIAN_WINDOW points, extrapolated linearly at both ends."""
    half = MEDIAN_WINDOW // 2
    inner = np.median(sliding_window_view(curve, MEDIAN_WINDOW, axis=0), axis=-1)
    reach = min(half, len(inner) - 1)
    ahead = np.arange(1, half + 1)[:, None]
    first = inner[0] - ahead[::-1] * (inner[reach] - inner[0]) / reach
    last = inner[-1] + ahead * (inner[-1] - inner[-1 - reach]) / reach
    return np.concatenate([first, inner, last])


def _to_grip(curve: Array, gripper: Array) -> Array:
    """Arc lengths [m] from each point of the curve (n, 2) to the gripper (n,)."""
    steps = np.hypot(*np.diff(np.concatenate([curve, gripper[None]]), axis=0).T)
    return np.asarray(np.cumsum(steps[::-1])[::-1])
