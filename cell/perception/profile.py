"""Midline in the plane of the near edge from the strip's borders in the image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.calibration import Calibration
from cell.perception.edges import Crossings, crossings
from cell.perception.silhouette import Side
from cell.perception.sizes import Sizes
from drivers.types import Array, Image


@dataclass(frozen=True, slots=True)
class Geometry:
    """Imaging geometry of a strip: calibration, thickness and width [m], `origin` (2,) [px] of the
    window in which outlines are given, and the camera's `sizes`.
    """

    calibration: Calibration
    thickness: float
    width: float
    origin: Array
    sizes: Sizes

    def plane(self, pixels: Array) -> Array:
        """(n, 2) [px] of the window -> (n, 2) x, z [m] in the plane of the near edge."""
        return self.calibration.to_plane(pixels + self.origin)

    @property
    def sweep(self) -> float:
        """Fraction of the distance to the foot by which the far edge appears shifted."""
        return self.calibration.viewpoint.sweep(self.width)


@dataclass(frozen=True, slots=True)
class MidlinePoints:
    """Points (n, 2) of the midline [m] in order, unit `tangents` (n, 2), and `seen` (n,) whether
    the band had the expected width; `scale` [m/px].
    """

    points: Array
    tangents: Array
    seen: NDArray[np.bool_]
    scale: float


def midline_points(levels: Image, side: Side, geometry: Geometry) -> MidlinePoints:
    """The strip's midline at each point of its outer side in matte `levels` (h, w).

    The outer side is the near edge where it faces away from the foot, the far edge elsewhere: a far
    edge is shifted back from the foot by the sweep, and the near edge is searched behind it.
    """
    place = geometry.plane(side.points)
    out = geometry.plane(side.points + side.normals) - place
    scale = float(np.median(np.hypot(*out.T)))
    out /= np.hypot(*out.T)[:, None]
    lever = ((place - geometry.calibration.viewpoint.foot()) * out).sum(axis=1)
    swept = np.abs(lever) * geometry.sweep
    seen = crossings(levels, side, (swept + geometry.thickness) / scale, geometry.sizes)
    points = _midline(place, out, lever, seen, geometry, scale)
    tangents = np.stack([-out[:, 1], out[:, 0]], axis=1)
    width = (seen.inner - seen.outer) * scale
    expected = swept + geometry.thickness
    good = (seen.strength > 0.2) & ~(width < expected - geometry.sizes.agree * scale)
    return MidlinePoints(points, tangents, good, scale)


def _midline(
    place: Array, out: Array, lever: Array, seen: Crossings, geometry: Geometry, scale: float
) -> Array:
    half = geometry.thickness / 2
    sweep, sizes = geometry.sweep, geometry.sizes
    swept = np.abs(lever) * sweep
    border = -seen.outer * scale  # along `out`, of the outer border
    near = border - half
    far = border - half - swept
    behind = -seen.inner * scale + half
    far = far + _far_offset((behind - far)[lever < 0], sizes.agree * scale)
    off = np.abs(behind - far) / scale
    visible = np.clip((sizes.close[1] - off) / (sizes.close[1] - sizes.close[0]), 0.0, 1.0)
    far = np.where(np.isfinite(behind), visible * behind + (1 - visible) * far, far)
    by_border = np.where(lever > 0, near, far)
    by_mass = -seen.middle * scale + np.sign(lever) * swept / 2
    band = (swept + geometry.thickness) / scale
    trust = np.clip((band - sizes.thin[0]) / (sizes.thin[1] - sizes.thin[0]), 0.0, 1.0)
    alone = np.isfinite(seen.inner) & ((seen.inner - seen.outer) < band + sizes.agree)
    trust = np.where(alone, trust, 1.0)
    shift = trust * by_border + (1 - trust) * by_mass
    return np.asarray(place + shift[:, None] * out)


def _far_offset(differences: Array, most: float) -> float:
    """Distance of the far edge from its prediction by the near edge [m], the median over all points
    that show both; caused by errors of stated width and thickness.
    """
    both = differences[np.abs(differences) < most]
    return float(np.median(both)) if len(both) >= 10 else 0.0


def order_points(midline: MidlinePoints, spacing: float) -> Array:
    """The midline's points (n, 2) at about equal `spacing` [m] in order, never doubling back.

    Where the outer side changes from near to far edge, its points repeat a section of the midline:
    they are sorted by arc length and averaged.
    """
    points, tangents = midline.points[midline.seen], midline.tangents[midline.seen]
    if len(points) < 4:
        return np.empty((0, 2))
    mean = tangents[1:] + tangents[:-1]
    mean /= np.maximum(np.hypot(*mean.T), 1e-9)[:, None]
    travel = np.concatenate([[0.0], np.cumsum((np.diff(points, axis=0) * mean).sum(axis=1))])
    bins = np.floor((travel - travel.min()) / spacing).astype(int)
    count = np.bincount(bins)
    filled = count > 0
    sums = np.stack([np.bincount(bins, points[:, c]) for c in range(2)], axis=1)
    return np.asarray(sums[filled] / count[filled, None])


def resample(points: Array, count: int) -> Array:
    """`count` points at equal steps along a polyline (n, 2), smoothed by local parabolas."""
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.linspace(0.0, travel[-1], count)
    even = np.stack([np.interp(at, travel, points[:, c]) for c in range(2)], axis=1)
    return _savgol(even)


KERNEL = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35  # parabola through five points


def _savgol(points: Array) -> Array:
    """Every point replaced by the parabola through it and two neighbours on each side."""
    smooth = points.copy()
    for c in range(points.shape[1]):
        smooth[2:-2, c] = np.convolve(points[:, c], KERNEL, mode="valid")
    return smooth
