"""Photograph of a strip that hangs over a ledge, reduced to the midline of the thin
object that enters at its left border.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from drivers.base.errors import ConfigurationError
from drivers.base.geometry import (
    arc_lengths,
    even_points,
    interpolate_columns,
    left_normals,
    moving_average,
    robust_sigma,
    running_sums,
    unit,
)
from drivers.base.readers import read_picture
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
    """Midline of an object in an image, as points from the left border on, a row of two
    coordinates [px] for each, and the `width` [px] of the object.
    """

    points: Array
    width: float

    @property
    def length(self) -> float:
        """Length of the midline [px]."""
        return float(arc_lengths(self.points)[-1])


def extract_midline(image: Image, count: int = 200) -> Midline:
    """Midline of the bright object that enters `image`, of shape (height, width, 3), at
    its left border, as `count` points.

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

    fine = _centre(
        _brightness(small), even_points(_smooth(rough, reach=2), count), width
    )
    midline = _to_ends(mask, fine, width)
    return Midline((even_points(midline, count) + 0.5) * scale - 0.5, width * scale)


def _brightness(image: Image) -> Image:
    """Brightness of each pixel of an image, which is that of its strongest colour
    channel.
    """
    return cast(Image, image.max(axis=2) if image.ndim == 3 else image)


def _find_object(grey: Image) -> tuple[Mask, float]:
    """Mask of the bright region at the left border of the image `grey`, without
    threads, and the region's width [px].
    """
    smooth = cv2.medianBlur(grey, 5)
    _, bright = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    is_uniform = bright.min() == bright.max()
    if is_uniform or smooth[bright > 0].mean() < smooth[bright == 0].mean() + CONTRAST:
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
    """Typical width [px] of the objects in a mask: twice their depth along
    the middle.
    """
    depth = cv2.distanceTransform(bright, cv2.DIST_L2, 5)
    ridge = depth[(depth > 1) & (depth >= cv2.dilate(depth, np.ones((3, 3))))]
    if not len(ridge):
        raise ConfigurationError("picture: no bright object is wider than two pixels")
    return 2 * float(np.percentile(ridge, 75))


def _geodesic_distance(mask: Mask) -> Array:
    """Distance [px] of each pixel inside the mask from its entry at the left border,
    along paths that stay inside; infinity outside.
    """
    count = int(mask.sum())
    index = np.full(np.add(mask.shape, 2), -1)  # with a border that is outside
    index[1:-1, 1:-1][mask] = np.arange(count)
    v, u = np.nonzero(index >= 0)

    ends = []
    lengths = []
    # half of a pixel's eight neighbours: the graph has no direction
    for dv, du in ((0, 1), (1, 0), (1, 1), (-1, 1)):
        neighbour = index[v + dv, u + du]
        joined = np.flatnonzero(neighbour >= 0)
        ends.append([joined, neighbour[joined]])
        lengths.append(np.full(len(joined), np.hypot(du, dv)))
    links = (np.concatenate(lengths), np.concatenate(ends, axis=1))
    graph = coo_matrix(links, shape=(count, count)).tocsr()

    entry = np.flatnonzero(u == 1)
    distance = np.full(mask.shape, np.inf)
    distance[mask] = dijkstra(graph, directed=False, indices=entry, min_only=True)
    return distance


def _level_centres(mask: Mask, distance: Array, step: float) -> Array:
    """Centres [px] of the bands into which the mask is cut at every `step` [px] of
    `distance`, a row of two coordinates for each.
    """
    reached = mask & np.isfinite(distance)
    v, u = np.nonzero(reached)
    band = (distance[reached] / step).astype(int)
    count = np.bincount(band)
    sums = np.stack([np.bincount(band, u), np.bincount(band, v)], axis=1)
    return sums[count > 0] / count[count > 0, None]


def _smooth(points: Array, reach: int) -> Array:
    """Moving average of `points`, a row for each, over `reach` neighbours on either
    side; the end points stay where they are.
    """
    mirrored = np.pad(points, ((reach, reach), (0, 0)), "reflect", reflect_type="odd")
    return moving_average(mirrored, 2 * reach + 1)


def _centre(grey: Image, points: Array, width: float) -> Array:
    """Copy of `points` [px], each shifted across the object to the centroid of the
    brightness in `grey` there.
    """
    normal = left_normals(unit(np.gradient(_smooth(points, reach=3), axis=0)))

    offsets = np.linspace(-width, width, 2 * int(2 * width) + 1)
    at = (points[:, None] + offsets[:, None] * normal[:, None]).astype(np.float32)
    border = cv2.BORDER_REPLICATE
    across = cv2.remap(grey, at, None, cv2.INTER_LINEAR, None, border)

    dark, bright = np.percentile(across, (10, 90), axis=1)[..., None]
    brightness = (across - dark) / np.maximum(bright - dark, 1.0)
    inside = np.clip(brightness - 0.5, 0.0, None)

    centroid = (inside * offsets).sum(axis=1) / np.maximum(inside.sum(axis=1), 1e-9)
    shift = np.clip(centroid, -0.3 * width, 0.3 * width)
    return _smooth(points + shift[:, None] * normal, reach=3)


def _to_ends(mask: Mask, points: Array, width: float) -> Array:
    """Copy of a midline of `points` [px], extended to the left border, and in a
    straight line to the object's tip.
    """
    entry = np.array([0.0, np.flatnonzero(mask[:, 0]).mean()])
    is_clear = np.hypot(*(points - entry).T) > 0.8 * width
    traced = points[np.argmax(is_clear) :]

    direction = traced[-1] - traced[-END_POINTS]
    direction /= np.linalg.norm(direction)
    onward = traced[-1] + np.arange(1.0, 2 * width)[:, None] * direction

    u, v = np.rint(onward).astype(int).T
    height, width_px = mask.shape
    in_image = (u >= 0) & (v >= 0) & (u < width_px) & (v < height)
    on_object = in_image & mask[v.clip(0, height - 1), u.clip(0, width_px - 1)]
    beyond = np.flatnonzero(~on_object)
    end = beyond[0] if len(beyond) else len(onward)
    return np.vstack([entry, traced, onward[:end]])


SHORTEST_OVERHANG, LONGEST_OVERHANG = 0.01, 2.0  # m of overhang
ROUGH_POINTS = 200  # of a first midline, which gives width and length
# widths between points of the second, which smooths over seven of them
TRACE_SPACING = 0.15
THICKEST_SHARE = 0.15  # of its length
FIT_SPACING = 0.5  # widths between the points that are fitted
FEWEST_POINTS, MOST_POINTS, MOST_TRACED = 60, 400, 4000
# points on either side of the parabola against which roughness is measured
SMOOTHING_POINTS = 5
PRECISION = 0.02  # widths; no midline is better, however smooth
CORRELATION = 1.5  # sqrt of the number of neighbours whose errors go together
UNSURE_END = 1.0  # widths at either end where a midline is less sure
END_SIGMA = 4.0  # times less


@dataclass(frozen=True, slots=True)
class Photograph:
    """Midline of a strip that hangs over a ledge in one photograph: points [m], their
    arc lengths `arc` [m], and their standard deviations.

    At a scale of `pixel` [m], as if the picture's border were the ledge. `sigma` (n,)
    [m] across the midline, `width` of the strip [m], `overhang` [m].
    """

    path: Path
    overhang: float
    image: Image
    points: Array
    arc: Array
    sigma: Array
    width: float
    pixel: float

    @property
    def name(self) -> str:
        """Name of the photograph's file without its suffix."""
        return self.path.stem


def read_photographs(
    paths: Sequence[Path], overhangs: Sequence[float]
) -> list[Photograph]:
    """Read the pictures at `paths` of strips that hang over a ledge by the lengths
    `overhangs` [m]; ConfigurationError for an unfit one.
    """
    if not paths:
        raise ConfigurationError(
            "--photo: is missing; give a photograph of the hanging strip"
        )
    if len(paths) != len(overhangs):
        raise ConfigurationError(
            f"--overhang: {len(overhangs)} given for {len(paths)} of --photo; give one"
            " for each, in the same order"
        )
    for overhang in overhangs:
        if not SHORTEST_OVERHANG <= overhang <= LONGEST_OVERHANG:
            raise ConfigurationError(
                f"--overhang: is {overhang:g} m, must be at least {SHORTEST_OVERHANG:g}"
                f" m and at most {LONGEST_OVERHANG:g} m, from the ledge to the tip"
                f" along the strip; if {overhang:g} is in mm, write {overhang:g}mm"
            )
    return [
        read_photograph(path, length)
        for path, length in zip(paths, overhangs, strict=True)
    ]


def read_photograph(path: Path, overhang: float) -> Photograph:
    """Read the picture at `path` of a strip that hangs over a ledge by the length
    `overhang` [m]; ConfigurationError for an unfit one.
    """
    image = read_picture(path)
    midline = _trace_midline(path, image)
    traced = midline.points * (1, -1)
    travel = arc_lengths(traced)
    length = travel[-1]
    pixel = overhang / length
    count = int(
        np.clip(length / (FIT_SPACING * midline.width), FEWEST_POINTS, MOST_POINTS)
    )
    arc = np.linspace(0.0, length, count)
    points = _average_points(traced, travel, arc)
    sigma = CORRELATION * max(_roughness(points), PRECISION * midline.width)
    ends = np.minimum(arc, length - arc) < UNSURE_END * midline.width
    return Photograph(
        path=path,
        overhang=overhang,
        image=image,
        points=points * pixel,
        arc=arc * pixel,
        sigma=sigma * np.where(ends, END_SIGMA, 1.0) * pixel,
        width=midline.width * pixel,
        pixel=pixel,
    )


def _trace_midline(path: Path, image: Image) -> Midline:
    """Midline of the strip in `image`, be it bright or else dark; ConfigurationError,
    with the reason for a bright one, where there is neither.
    """
    reasons = []
    for bright_strip in (image, cv2.bitwise_not(image)):
        try:
            return _trace_bright(bright_strip)
        except ConfigurationError as error:
            reasons.append(error)
    raise ConfigurationError(f"{path}: {reasons[0]}")


def _trace_bright(image: Image) -> Midline:
    """Midline of a bright strip that enters `image` at its left border;
    ConfigurationError where the object is too thick for a strip.
    """
    rough = extract_midline(image, ROUGH_POINTS)
    if rough.width < THICKEST_SHARE * rough.length:
        count = rough.length / (TRACE_SPACING * rough.width)
        return extract_midline(image, int(np.clip(count, ROUGH_POINTS, MOST_TRACED)))
    raise ConfigurationError(
        "picture: what enters at its left border is too thick for a strip"
    )


def _average_points(traced: Array, travel: Array, arc: Array) -> Array:
    """Mean of the traced points [px] around each of the arc lengths `arc` [px], a row
    of two coordinates for each.
    """
    reach = 0.5 * (arc[1] - arc[0])
    begin = np.clip(arc - reach, 0.0, travel[-1])
    end = np.clip(arc + reach, 0.0, travel[-1])

    # the integral of the points up to each of them, by trapezoids
    steps = np.diff(travel)[:, None] * 0.5 * (traced[1:] + traced[:-1])
    integral = running_sums(steps)
    before = interpolate_columns(begin, travel, integral)
    after = interpolate_columns(end, travel, integral)
    means: Array = (after - before) / (end - begin)[:, None]
    return means


def _roughness(points: Array) -> float:
    """Standard deviation [px] of the midline `points` [px] from parabolas through their
    neighbours, hardly affected by outliers.
    """
    window = 2 * SMOOTHING_POINTS + 1
    inner = slice(SMOOTHING_POINTS, -SMOOTHING_POINTS)
    miss = (points - savgol_filter(points, window, 2, axis=0))[inner]
    along = np.gradient(points, axis=0)[inner]
    across = (along[:, 0] * miss[:, 1] - along[:, 1] * miss[:, 0]) / np.hypot(*along.T)
    # a point weighs in its own parabola, which takes that share of its variance away
    return robust_sigma(across) / float(
        np.sqrt(1 - savgol_coeffs(window, 2)[SMOOTHING_POINTS])
    )
