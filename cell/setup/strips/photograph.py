"""Photograph of a strip that hangs over a ledge, reduced to the strip's midline."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from cell.setup.strips.midline import Midline, extract_midline
from drivers.base.errors import ConfigurationError
from drivers.base.geometry import arc_lengths, interpolate_columns
from drivers.base.readers import read_picture
from drivers.base.robust import robust_sigma
from drivers.base.types import Array, Image

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
    """Midline of a hanging strip: `points` (n, 2) [m] at arc lengths `arc` (n,) [m] to
    the tip.

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
    """Read pictures at `paths`, with overhangs [m]; ConfigurationError for an unfit
    picture.
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
    """Read the picture at `path` of a strip with `overhang` [m]; ConfigurationError if
    unfit.
    """
    image = read_picture(path)
    midline = _trace_midline(path, image)
    traced = midline.points * (1, -1)
    travel = arc_lengths(traced)
    pixel = overhang / travel[-1]
    count = int(
        np.clip(travel[-1] / (FIT_SPACING * midline.width), FEWEST_POINTS, MOST_POINTS)
    )
    arc = np.linspace(0.0, travel[-1], count)
    points = _average_points(traced, travel, arc)
    sigma = CORRELATION * max(roughness(points), PRECISION * midline.width)
    ends = np.minimum(arc, travel[-1] - arc) < UNSURE_END * midline.width
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
    """Midline of a bright, or else of a dark strip; of two failures the first is
    reported.
    """
    reasons = []
    for bright_strip in (image, cv2.bitwise_not(image)):
        try:
            return _trace_bright(bright_strip)
        except ConfigurationError as error:
            reasons.append(error)
    raise ConfigurationError(f"{path}: {reasons[0]}")


def _trace_bright(image: Image) -> Midline:
    """Midline of a bright strip from the left border; ConfigurationError for a thick
    object.
    """
    rough = extract_midline(image, ROUGH_POINTS)
    if rough.width < THICKEST_SHARE * rough.length:
        count = rough.length / (TRACE_SPACING * rough.width)
        return extract_midline(image, int(np.clip(count, ROUGH_POINTS, MOST_TRACED)))
    raise ConfigurationError(
        "picture: what enters at its left border is too thick for a strip"
    )


def _average_points(traced: Array, travel: Array, arc: Array) -> Array:
    """Mean traced points (n, 2) [px] around each of the arc lengths `arc` (n,) [px]."""
    reach = 0.5 * (arc[1] - arc[0])
    edges = np.clip(np.stack([arc - reach, arc + reach]), 0.0, travel[-1])
    steps = np.diff(travel)[:, None] * 0.5 * (traced[1:] + traced[:-1])
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    before, after = (interpolate_columns(edge, travel, sums) for edge in edges)
    means: Array = (after - before) / np.diff(edges, axis=0).T
    return means


def roughness(points: Array) -> float:
    """Robust deviation [px] of midline `points` (n, 2) [px] from parabolas through
    neighbours.
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
