"""Measurement of the resting strip in one image: colours, underside, free edge."""

from dataclasses import dataclass
from math import nan

import cv2
import numpy as np
from numpy.polynomial.polynomial import polyfit, polyval
from numpy.typing import NDArray

from calibration.calibration import Calibration
from cell.perception.kernels import strip_share
from drivers.base.types import Array, Image
from drivers.strip.file import StripFile

FRONT_HEIGHTS = (-0.008, -0.003)  # m of height where the desk shows before a thin strip
# m of thickness up to which it does; before a thicker one it shows lower down
THIN = 0.002
BACKDROP_HEIGHTS = (0.06, 0.25)  # m of height where the backdrop shows
SEARCH = 0.008  # m above and below rest in which the underside is searched
FACE = 0.7  # share of the strip's face, from the near edge on, that shows its colour
INNER = (0.3, 0.6)  # shares of the height of the strip's face, well inside it
DEGREE = 3  # of the polynomial that the homography's remainder follows
PAST_END = 0.06  # m past its stated length up to which the strip is searched


@dataclass(frozen=True, slots=True)
class Underside:
    """Underside of the resting strip, as heights `z` (n,) [m] of its midline at
    positions `x` (n,) [m].

    `z` is NaN where no strip is seen; `end` [m] is x of the strip's free edge.
    """

    x: Array
    z: Array
    end: float

    @property
    def present(self) -> NDArray[np.bool_]:
        """Mask (n,) of the positions `x` at which a strip is visible."""
        return np.isfinite(self.z)


@dataclass(frozen=True, slots=True)
class SceneSamples:
    """Pixels sampled before a fold, (n, 3) BGR each: of the resting strip, of the desk
    before it, and of the backdrop above it.
    """

    strip: Array
    desk: Array
    backdrop: Array

    @property
    def desk_colour(self) -> Array:
        """Median colour (3,) BGR of the sampled desk."""
        return np.median(self.desk, axis=0)


def sample_scene(
    image: Image, calibration: Calibration, strip: StripFile, rise: float = 0.0
) -> SceneSamples:
    """Sample pixels of `image` (height, width, 3) where strip, desk and backdrop should
    be, for a strip that rests `rise` [m] above z = 0.
    """
    lower = max(strip.thickness - THIN, 0.0) / 2 - rise
    front = (FRONT_HEIGHTS[0] - lower, FRONT_HEIGHTS[1] - lower)
    top = rise + FACE * face_height(calibration, strip)
    return SceneSamples(
        sample_rectangle(image, calibration, _span(strip, margin=0.05), (rise, top)),
        sample_rectangle(image, calibration, _span(strip, margin=0.03), front),
        sample_rectangle(
            image, calibration, _span(strip, margin=0.0), BACKDROP_HEIGHTS
        ),
    )


def inner_pixels(
    image: Image, calibration: Calibration, strip: StripFile, rise: float
) -> Array:
    """Pixels (n, 3) BGR of `image` well inside the strip's face, for a strip whose near
    edge appears at z = `rise` [m].
    """
    face = face_height(calibration, strip)
    height = (rise + INNER[0] * face, rise + INNER[1] * face)
    return sample_rectangle(image, calibration, _span(strip, margin=0.0), height)


def face_height(calibration: Calibration, strip: StripFile) -> float:
    """Height [m] at which the far edge of the resting strip appears, measured in the
    plane of its near edge.
    """
    return calibration.viewpoint.sweep(strip.width) * calibration.viewpoint.z


def _span(strip: StripFile, margin: float) -> tuple[float, float]:
    """Range of x [m] over the strip, from its fixed to its free end, less `margin` [m]
    and 1 cm at either end.
    """
    return margin + 0.01, strip.length - margin - 0.01


def sample_rectangle(
    image: Image,
    calibration: Calibration,
    span: tuple[float, float],
    height: tuple[float, float],
) -> Array:
    """Pixels (n, 3) BGR of `image` in a rectangle of the plane of the strip's near
    edge, over `span` in x and `height` in z [m].
    """
    grid = _grid(np.linspace(*span, 250), np.linspace(*height, 12))
    return sample_plane(image, calibration, grid).reshape(-1, 3)


def sample_plane(image: Image, calibration: Calibration, points: Array) -> Array:
    """Values (n, m, ...) of `image` at `points` (n, m, 2), x and z [m], in the plane of
    the strip's near edge.
    """
    pixels = calibration.to_image(points.reshape(-1, 2)).reshape(points.shape)
    at = pixels.astype(np.float32)
    border = cv2.BORDER_REPLICATE
    sampled: Image = cv2.remap(image, at, None, cv2.INTER_LINEAR, None, border)
    return sampled.astype(np.float64)


def _grid(x: Array, z: Array) -> Array:
    """Points (n, m, 2) with every pair of the coordinates `x` (n,) and `z` (m,) [m]."""
    return np.stack(np.meshgrid(x, z, indexing="ij"), axis=-1)


def strip_shares(
    levels: Image, calibration: Calibration, strip: StripFile, rise: float
) -> Array:
    """Fractions of strip (n,), 0 to 1, at each millimetre along the near side of a
    strip at rest.

    From the smoothed matte `levels` (h, w); the midline rests at a height `rise` [m].
    """
    x = np.arange(*_span(strip, margin=0.0), 0.001)
    z = rise + np.linspace(
        -strip.thickness / 4, INNER[0] * face_height(calibration, strip), 5
    )
    across = strip_share(sample_plane(levels, calibration, _grid(x, z)))
    shares: Array = across.mean(axis=1)
    return shares


def underside(
    levels: Image, calibration: Calibration, strip: StripFile, rise: float
) -> Underside:
    """Locate the underside of the resting strip in `levels` (h, w), the smoothed image
    of strip fractions; its free edge is sought at z = `rise` [m].
    """
    x = np.arange(0.005, strip.length + PAST_END, 0.002)
    z = np.arange(-SEARCH, SEARCH, 0.0001)
    across = strip_share(sample_plane(levels, calibration, _grid(x, z)))
    is_strip = across > 0.5
    first = is_strip.argmax(axis=1)  # sample from below, where there is strip at all
    found = is_strip.any(axis=1) & (first > 0)

    # where the share passes one half, linear between two samples
    rows = np.arange(len(x))
    before = across[rows, np.maximum(first - 1, 0)]
    change = np.maximum(across[rows, first] - before, 1e-6)
    sample = first - 1 + (0.5 - before) / change
    low = z[0] + sample * (z[1] - z[0])
    height = np.where(found, low + strip.thickness / 2, nan)
    return Underside(x, height, _free_edge(levels, calibration, strip, rise))


def _free_edge(
    levels: Image, calibration: Calibration, strip: StripFile, rise: float
) -> float:
    """Position x [m] of the strip's free edge along its near edge at z = `rise` [m];
    NaN where no strip is visible.
    """
    x = np.arange(0.1, strip.length + PAST_END, 0.0003)
    heights = rise + np.array([0.0, 0.0005, 0.001])
    along = strip_share(
        sample_plane(levels, calibration, _grid(x, heights)).max(axis=1)
    )
    inside = np.flatnonzero(along > 0.5)
    return float(x[inside[-1]]) if len(inside) else nan


def resting_line(seen: Underside) -> Array:
    """Coefficients (DEGREE + 1,), constant first, of the resting midline's height [m]
    as a polynomial of x [m], robust to a bump.
    """
    x = seen.x[seen.present]
    z = seen.z[seen.present]
    kept = np.ones(len(x), dtype=bool)
    fit: Array = np.zeros(DEGREE + 1)
    for _ in range(3):
        fit = np.asarray(polyfit(x[kept], z[kept], DEGREE))
        off = np.abs(z - polyval(x, fit))
        kept = off <= max(3.0 * np.median(off), 1e-4)
    return fit
