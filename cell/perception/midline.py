"""Midline of a thin bright object on a dark background, from the image border to its tip."""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from drivers.errors import ConfigurationError
from drivers.types import Array, Image

WORKING_HEIGHT = 1200  # px; larger pictures are shrunk for tracing, then refined in full size
CONTRAST = 40  # grey levels between object and background
FLUFF = 0.35  # of the width: threads thinner than this are not the object

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Midline:
    """Points (n, 2) u, v [px] at equal steps from entry to tip, and the object's width [px]."""

    points: Array
    width: float

    @property
    def length(self) -> float:
        """Length of the midline [px]."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum())


def extract_midline(image: Image, count: int = 200) -> Midline:
    """`count` points of the midline of the object that enters `image` (h, w, 3) at its left border.

    Fluff, specks and background gradients are ignored. An image without such an object is a
    ConfigurationError.
    """
    scale = max(1.0, image.shape[0] / WORKING_HEIGHT)
    small = cv2.resize(image, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
    mask, width = _object(_brightness(small))
    rough = _level_centres(mask, _travel(mask), 0.5 * width)
    fine = _centre(_brightness(small), _resample(_smooth(rough, 2), count), width)
    whole = _to_ends(mask, fine, width)
    return Midline((_resample(whole, count) + 0.5) * scale - 0.5, width * scale)


def _brightness(image: Image) -> Image:
    return cast(Image, image.max(axis=2) if image.ndim == 3 else image)


def _object(grey: Image) -> tuple[Mask, float]:
    """The bright region that touches the left border, without fluff, and its width."""
    smooth = cv2.medianBlur(grey, 5)
    _, bright = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    uniform = bright.min() == bright.max()
    if uniform or smooth[bright > 0].mean() - smooth[bright == 0].mean() < CONTRAST:
        raise ConfigurationError("picture: no bright object on a dark background")
    padded = cv2.copyMakeBorder(bright, 0, 0, 8, 0, cv2.BORDER_REPLICATE)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 5)
    ridge = depth[(depth > 1) & (depth >= cv2.dilate(depth, np.ones((3, 3))))]
    width = 2 * float(np.percentile(ridge, 75))
    size = 2 * int(FLUFF * width / 2) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    bodies = cv2.morphologyEx(padded, cv2.MORPH_OPEN, kernel)[:, 8:]
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(bodies, connectivity=4)
    entering = np.setdiff1d(np.unique(labels[:, 0]), [0])
    if len(entering) == 0:
        raise ConfigurationError("picture: no bright object enters at the left border")
    largest = entering[np.argmax(statistics[entering, cv2.CC_STAT_AREA])]
    return labels == largest, width


def _travel(mask: Mask) -> Array:
    """Geodesic distance inside the mask from its entry at the left border [px], inf outside."""
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(mask.sum())
    height, width = mask.shape
    rows, columns, lengths = [], [], []
    for dv, du in ((0, 1), (1, 0), (1, 1), (-1, 1)):
        here = index[max(0, -dv) : height - max(0, dv), : width - du]
        there = index[max(0, dv) : height - max(0, -dv), du:]
        joined = (here >= 0) & (there >= 0)
        rows.append(here[joined])
        columns.append(there[joined])
        lengths.append(np.full(joined.sum(), np.hypot(du, dv)))
    count = int(mask.sum())
    links = (np.concatenate(rows), np.concatenate(columns))
    graph = coo_matrix((np.concatenate(lengths), links), shape=(count, count)).tocsr()
    entry = index[:, 0][index[:, 0] >= 0]
    travel = np.full(mask.shape, np.inf)
    travel[mask] = dijkstra(graph, directed=False, indices=entry, min_only=True)
    return travel


def _level_centres(mask: Mask, travel: Array, step: float) -> Array:
    """Centres (n, 2) of the bands of equal distance, `step` wide [px]."""
    reached = mask & np.isfinite(travel)
    v, u = np.nonzero(reached)
    band = (travel[reached] / step).astype(int)
    weight = np.maximum(np.bincount(band), 1)
    centres = np.stack([np.bincount(band, u), np.bincount(band, v)], axis=1) / weight[:, None]
    return centres[np.bincount(band) > 0]


def _smooth(points: Array, reach: int) -> Array:
    """Moving average over 2 reach + 1 points that keeps the ends."""
    odd = [
        2 * points[0] - points[reach:0:-1],
        points,
        2 * points[-1] - points[-2 : -reach - 2 : -1],
    ]
    sums = np.cumsum(np.vstack([np.zeros((1, 2)), *odd]), axis=0)
    window = 2 * reach + 1
    return cast(Array, (sums[window:] - sums[:-window]) / window)


def _resample(points: Array, count: int) -> Array:
    """`count` points at equal steps along a polyline (n, 2)."""
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, travel[-1], count)
    return np.stack([np.interp(at, travel, points[:, c]) for c in range(2)], axis=1)


def _centre(grey: Image, points: Array, width: float) -> Array:
    """Points moved along their normals to the centre of brightness across the object."""
    tangent = np.gradient(_smooth(points, 3), axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    offsets = np.linspace(-width, width, 2 * int(2 * width) + 1)
    at = (points[:, None] + offsets[:, None] * normal[:, None]).astype(np.float32)
    across = cv2.remap(grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    dark = np.percentile(across, 10, axis=1, keepdims=True)
    bright = np.percentile(across, 90, axis=1, keepdims=True)
    inside = np.clip((across - dark) / np.maximum(bright - dark, 1.0) - 0.5, 0.0, None)
    shift = (inside * offsets).sum(axis=1) / np.maximum(inside.sum(axis=1), 1e-9)
    bounded = np.clip(shift, -0.3 * width, 0.3 * width)
    return _smooth(points + bounded[:, None] * normal, 3)


def _to_ends(mask: Mask, points: Array, width: float) -> Array:
    """The midline extended to the left border's cut, and straight to the tip."""
    cut = np.flatnonzero(mask[:, 0])
    entry = np.array([0.0, cut.mean()])
    clear = np.hypot(*(points - entry).T) > 0.8 * width
    kept = points[int(np.argmax(clear)) :]
    tip = kept[-1]
    onward = tip - kept[-8]
    onward /= np.linalg.norm(onward)
    steps = tip + np.arange(1.0, 2 * width)[:, None] * onward
    cells = np.rint(steps).astype(int)
    within = ((cells >= 0) & (cells < (mask.shape[1], mask.shape[0]))).all(axis=1)
    inside = np.zeros(len(steps), dtype=bool)
    inside[within] = mask[cells[within, 1], cells[within, 0]]
    last = len(inside) if inside.all() else int(np.argmin(inside))
    return np.vstack([entry, kept, steps[:last]])
