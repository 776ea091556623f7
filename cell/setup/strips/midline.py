"""Midline of a thin bright object on a dark background, from the image border to its
tip.
"""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from drivers.base.errors import ConfigurationError
from drivers.base.geometry import (
    even_points,
    left_normals,
    moving_average,
    unit,
)
from drivers.base.types import Array, Image

# px; larger pictures are shrunk for tracing, then refined in full size
WORKING_HEIGHT = 1200
CONTRAST = 40  # grey levels between object and background
FLUFF = 0.35  # of the width: threads thinner than this are not the object
BORDER = 8  # px by which the object is continued over the left border
END_POINTS = 8  # points of the midline that give the direction to the tip
FEWEST_LEVELS = 3  # half widths along an object that has a line to trace

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Midline:
    """Midline of an object in an image: `points` (n, 2) u, v [px]; `width` [px] of the
    object.
    """

    points: Array
    width: float

    @property
    def length(self) -> float:
        """Length of the midline [px]."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum())


def extract_midline(image: Image, count: int = 200) -> Midline:
    """Trace the midline of the object at the left border of `image` (h, w, 3) by
    `count` points.

    Points are at equal steps from the border to the tip; fluff, specks and background
    gradients are ignored. Raises ConfigurationError for an image without such an
    object.
    """
    scale = max(1.0, image.shape[0] / WORKING_HEIGHT)
    small = cv2.resize(
        image, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA
    )
    mask, width = _find_object(_brightness(small))
    rough = _level_centres(mask, _geodesic_distance(mask), 0.5 * width)
    if len(rough) < FEWEST_LEVELS:
        raise ConfigurationError("picture: what enters at its left border is no strip")
    fine = _centre(_brightness(small), even_points(_smooth(rough, 2), count), width)
    midline = _to_ends(mask, fine, width)
    return Midline((even_points(midline, count) + 0.5) * scale - 0.5, width * scale)


def _brightness(image: Image) -> Image:
    """Brightness (h, w) of an image (h, w) or (h, w, 3): its strongest channel."""
    return cast(Image, image.max(axis=2) if image.ndim == 3 else image)


def _find_object(grey: Image) -> tuple[Mask, float]:
    """Mask (h, w) of the bright region at the left border, without threads, and its
    width [px].
    """
    smooth = cv2.medianBlur(grey, 5)
    _, bright = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    uniform = bright.min() == bright.max()
    if uniform or smooth[bright > 0].mean() - smooth[bright == 0].mean() < CONTRAST:
        raise ConfigurationError("picture: no bright object on a dark background")
    padded = cv2.copyMakeBorder(bright, 0, 0, BORDER, 0, cv2.BORDER_REPLICATE)
    width = _width(padded)
    size = 2 * int(FLUFF * width / 2) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    bodies = cv2.morphologyEx(padded, cv2.MORPH_OPEN, kernel)[:, BORDER:]
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(bodies, connectivity=4)
    entering = np.setdiff1d(np.unique(labels[:, 0]), [0])
    if len(entering) == 0:
        raise ConfigurationError("picture: no bright object enters at the left border")
    largest = entering[np.argmax(statistics[entering, cv2.CC_STAT_AREA])]
    return labels == largest, width


def _width(bright: Image) -> float:
    """Width [px] of the objects in a mask (h, w): twice their depth along the
    middle.
    """
    depth = cv2.distanceTransform(bright, cv2.DIST_L2, 5)
    ridge = depth[(depth > 1) & (depth >= cv2.dilate(depth, np.ones((3, 3))))]
    if not len(ridge):
        raise ConfigurationError("picture: no bright object is wider than two pixels")
    return 2 * float(np.percentile(ridge, 75))


def _geodesic_distance(mask: Mask) -> Array:
    """Distance (h, w) [px] inside the mask from its entry at the left border, inf
    outside.
    """
    count = int(mask.sum())
    index = np.full(mask.shape, -1)
    index[mask] = np.arange(count)

    pixels, neighbours, lengths = [], [], []
    # half of a pixel's eight neighbours: the graph has no direction
    for dv, du in ((0, 1), (1, 0), (1, 1), (-1, 1)):
        pixel, neighbour = _joined(index, dv, du)
        pixels.append(pixel)
        neighbours.append(neighbour)
        lengths.append(np.full(len(pixel), np.hypot(du, dv)))
    links = (np.concatenate(pixels), np.concatenate(neighbours))
    graph = coo_matrix((np.concatenate(lengths), links), shape=(count, count)).tocsr()

    entry = index[:, 0][index[:, 0] >= 0]
    distance = np.full(mask.shape, np.inf)
    distance[mask] = dijkstra(graph, directed=False, indices=entry, min_only=True)
    return distance


def _joined(index: Array, dv: int, du: int) -> tuple[Array, Array]:
    """Pairs (n,), (n,) of pixels of `index` (h, w) that lie `dv` rows and `du` columns
    apart.

    `index` counts the object's pixels and is -1 outside; `du` is 0 or 1.
    """
    height, width = index.shape
    pixel = index[max(0, -dv) : height - max(0, dv), : width - du]
    neighbour = index[max(0, dv) : height - max(0, -dv), du:]
    joined = (pixel >= 0) & (neighbour >= 0)
    return pixel[joined], neighbour[joined]


def _level_centres(mask: Mask, distance: Array, step: float) -> Array:
    """Centroids (n, 2), u and v [px], of bands of the mask, each `step` [px] of
    `distance` wide.
    """
    reached = mask & np.isfinite(distance)
    v, u = np.nonzero(reached)
    band = (distance[reached] / step).astype(int)
    weight = np.maximum(np.bincount(band), 1)
    centres = (
        np.stack([np.bincount(band, u), np.bincount(band, v)], axis=1) / weight[:, None]
    )
    return centres[np.bincount(band) > 0]


def _smooth(points: Array, reach: int) -> Array:
    """Moving average of points (n, 2) over 2 reach + 1 of them; the end points stay."""
    mirrored = np.pad(points, ((reach, reach), (0, 0)), "reflect", reflect_type="odd")
    return moving_average(mirrored, 2 * reach + 1)


def _centre(grey: Image, points: Array, width: float) -> Array:
    """Shift points (n, 2) along their normals to the centroid of brightness across the
    object.
    """
    normal = left_normals(unit(np.gradient(_smooth(points, 3), axis=0)))

    offsets = np.linspace(-width, width, 2 * int(2 * width) + 1)
    at = (points[:, None] + offsets[:, None] * normal[:, None]).astype(np.float32)
    border = cv2.BORDER_REPLICATE
    across = cv2.remap(grey, at, None, cv2.INTER_LINEAR, None, border)

    dark = np.percentile(across, 10, axis=1, keepdims=True)
    bright = np.percentile(across, 90, axis=1, keepdims=True)
    inside = np.clip((across - dark) / np.maximum(bright - dark, 1.0) - 0.5, 0.0, None)

    shift = (inside * offsets).sum(axis=1) / np.maximum(inside.sum(axis=1), 1e-9)
    bounded = np.clip(shift, -0.3 * width, 0.3 * width)
    return _smooth(points + bounded[:, None] * normal, 3)


def _to_ends(mask: Mask, points: Array, width: float) -> Array:
    """Extend a midline (n, 2) to the left border, and in a straight line to the
    object's tip.
    """
    entry = np.array([0.0, np.flatnonzero(mask[:, 0]).mean()])
    clear = np.hypot(*(points - entry).T) > 0.8 * width
    traced = points[int(np.argmax(clear)) :]
    direction = traced[-1] - traced[-END_POINTS]
    direction /= np.linalg.norm(direction)
    onward = traced[-1] + np.arange(1.0, 2 * width)[:, None] * direction
    pixels = np.rint(onward).astype(int)
    in_image = ((pixels >= 0) & (pixels < (mask.shape[1], mask.shape[0]))).all(axis=1)
    on_object = np.zeros(len(onward), dtype=bool)
    on_object[in_image] = mask[pixels[in_image, 1], pixels[in_image, 0]]
    end = len(onward) if on_object.all() else int(np.argmin(on_object))
    return np.vstack([entry, traced, onward[:end]])
