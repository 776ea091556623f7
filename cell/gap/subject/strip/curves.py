"""Images of the visible midline as unlabelled points, wild ones left out, thinned."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cell.record.columns import Profile
from drivers.types import Array, frozen

APART = 0.045  # s between images that are compared: nearer ones say the same again
POINTS = 40  # of one image that are compared
WINDOW = 7  # points of the running median from which wild ones stand out
OFF = 6.0  # standard deviations from it, and the distance between points, that make one wild
FEWEST = 5  # points of an image that is used


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
        if stamp < last + APART:
            continue
        kept = curve[believable(curve, sigma)]
        if len(kept) < FEWEST:
            continue
        s = length - _to_grip(kept, gripper)
        chosen = np.unique(np.linspace(0, len(kept) - 1, POINTS).round().astype(np.int64))
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
    if len(curve) <= WINDOW:
        return np.ones(len(curve), dtype=bool)
    off = np.hypot(*(curve - running_median(curve)).T)
    spacing = float(np.median(np.hypot(*np.diff(curve, axis=0).T)))
    return np.asarray(off < OFF * sigma + spacing)


def running_median(curve: Array) -> Array:
    """Medians (n, 2) of WINDOW points about each point, carried on straight to both ends."""
    half = WINDOW // 2
    inner = np.median(sliding_window_view(curve, WINDOW, axis=0), axis=-1)
    reach = min(half, len(inner) - 1)
    ahead = np.arange(1, half + 1)[:, None]
    first = inner[0] - ahead[::-1] * (inner[reach] - inner[0]) / reach
    last = inner[-1] + ahead * (inner[-1] - inner[-1 - reach]) / reach
    return np.concatenate([first, inner, last])


def _to_grip(curve: Array, gripper: Array) -> Array:
    """Way along the curve (n, 2) from each of its points to the gripper (n,) [m]."""
    steps = np.hypot(*np.diff(np.concatenate([curve, gripper[None]]), axis=0).T)
    return np.asarray(np.cumsum(steps[::-1])[::-1])
