"""Midline of the lifted strip in the plane of its near edge, found from the strip's
borders in an image.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.calibration import Calibration
from cell.perception.kernels import ZERO_LEVEL, strip_share
from cell.perception.region import Sizes
from cell.perception.silhouette import Side
from drivers.base.geometry import even_points, left_normals, lengths, running_sums
from drivers.base.types import Array, Image

PLATEAU = (0.55, 1.3)  # matte levels of the strip as its brightness varies
OUTLINE_ERROR = 2  # px by which the outline may lie outside the border
FAR_ROOM = 4.0  # px of a line beyond the widest band, where it falls off
# px about a band, within which its peak and its mass lie
PEAK_REACH, MASS_REACH = 1.0, 3.0
# px before the outline from where a line starts; between its samples
OUTSIDE, STEP = 4.0, 0.5
THIN = (2.5, 4.5)  # px: narrower bands are read by their centre of mass
AGREE = 2.5  # px by which a band's width may differ from the geometry
CLOSE = (0.6, 1.2)  # px: an inner border this near to its place is the near edge
FEWEST_POINTS = 4  # of a midline, from which it is averaged
SPACING = 0.002  # m over which the midline is averaged
PROFILE_POINTS = 150

Samples = NDArray[np.int64]  # numbers of samples on lines across the outline


@dataclass(frozen=True, slots=True)
class Crossings:
    """Where n lines across the strip in an image cross its borders, as offsets (n,)
    [px] along the inward normal.

    Offsets count from the outline's point. `outer` is the border that faces the
    outside, `inner` the far side of the same band (NaN where it runs into another
    layer), `middle` its centre of mass, `strength` (n,) the share of strip at its
    strongest.
    """

    outer: Array
    inner: Array
    middle: Array
    strength: Array


def crossings(levels: Image, side: Side, band: Array, sizes: Sizes) -> Crossings:
    """Find both borders of the strip in the image of strip fractions `levels`, on a
    line across each of the n points of its outline `side`.

    `band` (n,) [px] is how wide geometry says the band is there. A border lies where
    the share passes half of the strongest one within the band, kept within PLATEAU.
    """
    offsets = np.arange(-OUTSIDE, sizes.deep + STEP / 2, STEP)
    across = _shares_across(levels, side, offsets)
    width = np.clip(band, 1.0, sizes.deep - FAR_ROOM)

    shares = np.where(_near_band(offsets, width, PEAK_REACH), across, -1.0)
    peak = shares.argmax(axis=1)  # sample, as `latest`, `rise` and `fall`
    strength = np.maximum(shares.max(axis=1), 0.0)
    level = 0.5 * np.clip(strength, *PLATEAU)

    low = across <= level[:, None]
    latest = int((OUTSIDE + OUTLINE_ERROR) / STEP) + np.round(width).astype(np.int64)
    rise = _last_before(low, np.minimum(np.maximum(peak, 1), latest))
    fall = _first_after(low, np.maximum(peak, rise + 1))

    outer = _level_crossing(across, offsets, rise, level)
    inner = _level_crossing(across, offsets, fall - 1, level)
    inner = np.where(fall < len(offsets), inner, np.nan)

    near = _near_band(offsets, width, MASS_REACH)
    mass = np.where(near, np.maximum(across, 0.0), 0.0)
    middle = (mass * offsets).sum(axis=1) / np.maximum(mass.sum(axis=1), 1e-6)
    return Crossings(outer, inner, middle, strength)


def _shares_across(levels: Image, side: Side, offsets: Array) -> Array:
    """Fractions of strip (n, m) in the image `levels`, at `offsets` (m,) [px] inwards
    from each of the n points of the outline `side`.
    """
    at = side.points[:, None] - offsets[None, :, None] * side.normals[:, None]
    at = at.astype(np.float32)
    sampled = cv2.remap(levels, at, None, cv2.INTER_LINEAR, borderValue=ZERO_LEVEL)
    return strip_share(sampled)


def _last_before(mask: NDArray[np.bool_], end: Samples) -> Samples:
    """Index (n,) of the last true column before `end` (n,) in each row of `mask` (n,
    m); 0 where there is none.
    """
    column = np.arange(mask.shape[1])
    last: Samples = np.where(mask & (column < end[:, None]), column, 0).max(axis=1)
    return last


def _first_after(mask: NDArray[np.bool_], start: Samples) -> Samples:
    """Index (n,) of the first true column after `start` (n,) in each row of `mask` (n,
    m); m where there is none.
    """
    column = np.arange(mask.shape[1])
    after = mask & (column > start[:, None])
    first: Samples = np.where(after, column, len(column)).min(axis=1)
    return first


def _near_band(offsets: Array, width: Array, reach: float) -> NDArray[np.bool_]:
    """Mask (n, m) of the offsets (m,) [px] that lie in a band from 0 to `width` (n,)
    [px], or within `reach` [px] of it.
    """
    return (offsets >= -reach) & (offsets <= width[:, None] + reach)


def _level_crossing(
    across: Array, offsets: Array, left: Samples, level: Array
) -> Array:
    """Offsets (n,) [px] at which values `across` n lines pass `level` (n,) between the
    sample `left` (n,) and the next one.
    """
    rows = np.arange(len(across))
    before = across[rows, left]
    change = across[rows, np.minimum(left + 1, len(offsets) - 1)] - before
    part = (level - before) / np.where(np.abs(change) >= 1e-6, change, 1e-6)
    crossing: Array = offsets[left] + STEP * np.clip(part, 0.0, 1.0)
    return crossing


KERNEL = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35  # parabola through five points


@dataclass(frozen=True, slots=True)
class Geometry:
    """Geometry of a strip in the image: its `thickness` and `width` [m], and the first
    pixel `origin` (2,) of the image window.
    """

    calibration: Calibration
    thickness: float
    width: float
    origin: Array
    sizes: Sizes

    def plane(self, pixels: Array) -> Array:
        """Convert window pixels (n, 2) to points (n, 2) x, z [m] in the plane of the
        near edge.
        """
        return self.calibration.to_plane(pixels + self.origin)

    @property
    def sweep(self) -> float:
        """Fraction of its distance from the camera's foot point, by which the strip's
        far edge appears nearer to that point than the near edge does.
        """
        return self.calibration.viewpoint.sweep(self.width)


@dataclass(frozen=True, slots=True)
class OuterSide:
    """Outer side of the strip at n points, as it appears in the plane of the strip's
    near edge.

    `points` (n, 2) [m], unit normals `out` (n, 2) of the strip, `lever` (n,) [m] along
    them from the camera's foot point: positive where the side is the near edge, else it
    is the far edge, which appears `swept` (n,) [m] nearer to the foot; `scale` [m/px].
    """

    points: Array
    out: Array
    lever: Array
    swept: Array
    scale: float

    @classmethod
    def from_image(cls, side: Side, geometry: Geometry) -> Self:
        """Outer side of the strip in that plane, from its image `side`."""
        points = geometry.plane(side.points)
        out = geometry.plane(side.points + side.normals) - points
        sizes = lengths(out)  # m of a pixel
        out /= sizes[:, None]
        lever = ((points - geometry.calibration.viewpoint.foot()) * out).sum(axis=1)
        swept = np.abs(lever) * geometry.sweep
        return cls(
            points=points,
            out=out,
            lever=lever,
            swept=swept,
            scale=float(np.median(sizes)),
        )


class SeenMidline(NamedTuple):
    """Midline `points` (m, 2) [m] of a strip, and the fraction `visible` of them at
    which the strip looks as wide as it should.
    """

    points: Array
    visible: float


def midline_points(levels: Image, side: Side, geometry: Geometry) -> SeenMidline:
    """Midline of the lifted strip at steps of SPACING, from its outer `side` in the
    image of strip fractions `levels` (h, w).
    """
    outer = OuterSide.from_image(side, geometry)
    expected = outer.swept + geometry.thickness  # m, width of the band
    borders = crossings(levels, side, expected / outer.scale, geometry.sizes)
    points = _midline(outer, borders, geometry.thickness)
    tangents = left_normals(outer.out)
    width = (borders.inner - borders.outer) * outer.scale
    good = (borders.strength > 0.2) & ~(width < expected - AGREE * outer.scale)
    return SeenMidline(
        _average_in_order(points[good], tangents[good]), float(good.mean())
    )


def _midline(outer: OuterSide, borders: Crossings, thickness: float) -> Array:
    """Midline points (n, 2) [m] of the strip: from its borders where it appears wide,
    from the centre between them where narrow.
    """
    scale = outer.scale
    # [m] along `out`, as all below
    by_near_edge = -borders.outer * scale - thickness / 2
    by_far_edge = _by_far_edge(by_near_edge - outer.swept, outer, borders, thickness)
    by_border = np.where(outer.lever > 0, by_near_edge, by_far_edge)
    by_mass = -borders.middle * scale + np.sign(outer.lever) * outer.swept / 2

    band = (outer.swept + thickness) / scale  # px
    trust = np.interp(band, THIN, (0.0, 1.0))
    # NaN, and so false, where the band runs into another layer
    is_alone = borders.inner - borders.outer < band + AGREE
    trust = np.where(is_alone, trust, 1.0)
    shift = trust * by_border + (1 - trust) * by_mass
    return outer.points + shift[:, None] * outer.out


def _by_far_edge(
    predicted: Array, outer: OuterSide, borders: Crossings, thickness: float
) -> Array:
    """Offset (n,) [m] of the midline along the normals of the outer side, where that
    side is the strip's far edge.

    It is `predicted` (n,) by the far edge; where the near edge is visible behind it, by
    that.
    """
    scale = outer.scale
    behind = -borders.inner * scale + thickness / 2
    apart = (behind - predicted)[outer.lever < 0]
    predicted = predicted + _far_offset(apart, AGREE * scale)

    off = np.abs(behind - predicted) / scale
    nearest, farthest = CLOSE
    visible = np.clip((farthest - off) / (farthest - nearest), 0.0, 1.0)
    mixed = visible * behind + (1 - visible) * predicted
    return np.where(np.isfinite(behind), mixed, predicted)


def _far_offset(differences: Array, limit: float) -> float:
    """Median [m] of the `differences` (n,) by which the midline seen at the near edge
    lies off the one predicted from the far edge; 0 for too few.

    Only those under `limit` [m] count; errors of stated width and thickness cause it.
    """
    close = differences[np.abs(differences) < limit]
    return float(np.median(close)) if len(close) >= 10 else 0.0


def _average_in_order(points: Array, tangents: Array) -> Array:
    """Mean points (m, 2) [m] of a curve in order of arc length, one per SPACING, from
    `points` (n, 2) with unit `tangents` (n, 2).

    Where the outer side changes from near to far edge, its points repeat a section of
    the midline.
    """
    if len(points) < FEWEST_POINTS:
        return np.empty((0, 2))
    mean = tangents[1:] + tangents[:-1]
    mean /= np.maximum(lengths(mean), 1e-9)[:, None]
    steps = (np.diff(points, axis=0) * mean).sum(axis=1)
    travel = running_sums(steps)

    bins = np.floor((travel - travel.min()) / SPACING).astype(int)
    count = np.bincount(bins)
    sums = np.stack([np.bincount(bins, column) for column in points.T], axis=1)
    return sums[count > 0] / count[count > 0, None]


def resample(points: Array) -> Array:
    """Resample a polyline (n, 2) to PROFILE_POINTS points at equal steps, smoothed by
    local parabolas.
    """
    even = even_points(points, PROFILE_POINTS)
    for column in even.T:
        column[2:-2] = np.convolve(column, KERNEL, mode="valid")
    return even
