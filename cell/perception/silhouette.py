"""Mask of the strip in an image, and its outer side as points in order from the desk
contact to the gripper.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.perception.kernels import LEVEL_SPAN, ZERO_LEVEL, Offsets, silhouette_of
from cell.perception.region import Sizes
from drivers.base.geometry import left_normals, lengths, moving_average
from drivers.base.types import Array, Image

SOLID = 0.35  # share of strip from which a pixel belongs to it, near the desk
SLANTS = (0.0, -65.0, -45.0, -25.0, 25.0, 45.0, 65.0)  # degrees from the columns
FACING = 0.8  # cosine within which two tips point at each other
AT_GRIP = 6  # px from the gripper at which a region needs no bridge to another
# px of any camera, by the pixel grid and a lens's blur of about a pixel
SHORTEST_OUTLINE = 12  # shorter ones are noise
OUTLINE_STEP = 3  # px between points along the outline
AVERAGE = 4  # along the outline to either side, over which it is averaged
TIP_ARM = 8  # from a tip both ways along the outline
TIP_WIDTH = 5.0  # how near to itself the outline is there

Outline = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Side:
    """Outer side of the strip in the image window, in order from desk contact to
    gripper.

    `points` (n, 2) [px], unit `normals` (n, 2) out of the strip.
    """

    points: Array
    normals: Array


@dataclass(frozen=True, slots=True)
class FingerZone:
    """Part of the image window that the fingers cover, where points of the strip's
    outline are ignored.

    The gripper point (2,) [px], its unit `approach` (2,), and how far the part reaches
    in front of the point, `clearance` [px], and `aside` of it [px].
    """

    point: Array
    approach: Array
    clearance: float
    aside: float

    def cuts(self, outline: Array) -> NDArray[np.bool_]:
        """Mask (n,) of the points of `outline` (n, 2) [px] that the fingers cover."""
        away = outline - self.point
        along = away @ self.approach
        aside = np.abs(away @ np.array([-self.approach[1], self.approach[0]]))
        is_near = np.maximum(aside, along) < self.aside
        covered: NDArray[np.bool_] = (along > -self.clearance) & is_near
        return covered


def silhouette(
    levels: Image, faint: float, strip: Image, lifted: Image, length: int
) -> Image:
    """Mask (h, w) of the strip, 255 inside, from `levels`, the smoothed image of strip
    fractions.

    The share of strip is SOLID in the zone `strip`, `faint` in its part `lifted`: on
    the backdrop there is no shadow, and an edge-on strip is fainter than its colour.
    Averaging over `length` [px] along the way on which it hangs raises it above the
    noise.
    """
    solid_level = round(ZERO_LEVEL + LEVEL_SPAN * SOLID)
    faint_level = round(ZERO_LEVEL + LEVEL_SPAN * faint)
    reach = length // 2
    wide = cv2.copyMakeBorder(levels, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    return silhouette_of(
        wide, strip, lifted, _line_offsets(length), solid_level, faint_level
    )


@lru_cache
def _line_offsets(length: int) -> Offsets:
    """Offsets (lines, `length`, 2), row and column [px], of the points on lines of
    `length` points, one line in each direction of SLANTS.
    """
    steps = np.arange(length) - length // 2
    directions = [(np.cos(angle), np.sin(angle)) for angle in np.radians(SLANTS)]
    return np.rint(steps[None, :, None] * np.array(directions)[:, None]).astype(
        np.int64
    )


def outer_side(
    mask: Image, contact: Array, grip: FingerZone, sizes: Sizes
) -> Side | None:
    """Outer side of the strip in `mask` (h, w), from the desk contact `contact` (2,)
    [px] to the fingers.

    A point every OUTLINE_STEP. With the strip on its left the outline runs from under
    the contact around the fold, up to the fingers. None where no region of strip is
    seen at the contact.
    """
    outline = _body(mask, contact, grip.point, sizes)
    if outline is None:
        return None
    start = _nearest_point(outline, contact)
    ring = np.roll(outline, -start, axis=0)
    cut = grip.cuts(ring)
    end = int(np.argmax(cut)) if cut.any() else _nearest_point(ring, grip.point)
    if end < 3 * OUTLINE_STEP:
        return None

    wrapped = np.vstack([ring[-AVERAGE:], ring, ring[:AVERAGE]])
    smooth = moving_average(wrapped, 2 * AVERAGE + 1)
    tangent = np.roll(smooth, -2, axis=0) - np.roll(smooth, 2, axis=0)
    speed = lengths(tangent)
    tangent /= np.maximum(speed, 1e-9)[:, None]
    normals = left_normals(tangent)

    rows = np.arange(0, end + 1, OUTLINE_STEP)
    # where the outline turns back on itself it has no side
    rows = rows[speed[rows] > 0.5]
    return Side(smooth[rows], normals[rows])


def _nearest_point(points: Array, to: Array) -> int:
    """Index of the one of `points` (n, 2) that is nearest to the point `to` (2,)."""
    return int(np.argmin(np.linalg.norm(points - to, axis=1)))


def _body(mask: Image, contact: Array, gripper: Array, sizes: Sizes) -> Array | None:
    """Outline (n, 2) [px] of the strip in `mask` (h, w) at the desk contact,
    counter-clockwise as seen in the image.

    Breaks are bridged in `mask` (h, w): between regions, and in one whose parts are
    connected elsewhere, as touching layers are. None where no region is large enough.
    """
    outlines = _outlines(mask)
    if not outlines:
        return None

    body = _nearest(outlines, contact)
    if _bridge_regions(mask, body, outlines, gripper, sizes.bridge):
        body = _nearest(_outlines(mask), contact)

    for tip, facing_tip in _facing_tips(body, sizes.bridge):
        cv2.line(mask, tip.tolist(), facing_tip.tolist(), 255, 1)
        body = _nearest(_outlines(mask), contact)

    if len(body) < 4 * AVERAGE:
        return None

    if cv2.contourArea(body.reshape(-1, 1, 2), oriented=True) >= 0:  # clockwise
        body = body[::-1]

    return np.asarray(body, dtype=np.float64)


def _bridge_regions(
    mask: Image, body: Outline, outlines: list[Outline], gripper: Array, longest: float
) -> bool:
    """Join the region with outline `body` in `mask` (h, w) to the next regions by
    lines, until a region reaches the gripper.

    Returns whether a line was drawn; none is drawn over more than `longest` [px].
    """
    others = [outline for outline in outlines if outline is not body]
    bridged = False
    while others and lengths(body - gripper).min() > AT_GRIP:
        pairs = [_closest(body, other) for other in others]
        gaps = [lengths(start - end) for start, end in pairs]
        nearest = int(np.argmin(gaps))
        if gaps[nearest] > longest:
            break

        start, end = pairs[nearest]
        cv2.line(mask, start.tolist(), end.tolist(), 255, 1)
        body = np.vstack([body, others.pop(nearest)])
        bridged = True
    return bridged


def _outlines(mask: Image) -> list[Outline]:
    """Outlines (n, 2) [px] of those regions of `mask` (h, w) whose outline has at least
    SHORTEST_OUTLINE points.
    """
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return [
        outline.reshape(-1, 2)
        for outline in outlines
        if len(outline) >= SHORTEST_OUTLINE
    ]


def _nearest(outlines: list[Outline], point: Array) -> Outline:
    """Outline among `outlines` that comes nearest to `point` (2,) [px]."""
    return min(outlines, key=lambda outline: lengths(outline - point).min())


def _facing_tips(outline: Outline, longest: float) -> list[tuple[Outline, Outline]]:
    """Pairs of tips (2,) [px] of `outline` (n, 2) that face each other less than
    `longest` [px] apart.
    """
    tips, directions = _tips(outline)
    pairs = []
    for i, j in combinations(range(len(tips)), 2):
        across = (tips[j] - tips[i]).astype(np.float64)
        length = lengths(across)
        # px, cosine times length
        aligned = min(directions[i] @ across, -(directions[j] @ across))
        if 0.0 < length < longest and aligned > FACING * length:
            pairs.append((tips[i], tips[j]))
    return pairs


def _tips(outline: Outline) -> tuple[Outline, Array]:
    """Tips (k, 2) [px] at which `outline` (n, 2) turns back on itself, and the unit
    directions (k, 2) in which they point.

    There its points TIP_ARM before and after are less than TIP_WIDTH apart.
    """
    after = np.roll(outline, -TIP_ARM, axis=0)
    before = np.roll(outline, TIP_ARM, axis=0)
    outwards = outline - 0.5 * (after + before)
    length = lengths(outwards)
    is_narrow = lengths(after - before) < TIP_WIDTH
    is_tip = is_narrow & (length > 0.6 * TIP_ARM)

    first = np.flatnonzero(is_tip & ~np.roll(is_tip, 1))
    last = np.flatnonzero(is_tip & ~np.roll(is_tip, -1))
    # the last run ends after the outline's first point
    if len(first) and first[0] > last[0]:
        last = np.append(last[1:], last[0] + len(is_tip))
    middle = ((first + last) // 2) % len(is_tip)
    return outline[middle], outwards[middle] / length[middle, None]


def _closest(one: Outline, other: Outline) -> tuple[Outline, Outline]:
    """Nearest two points (2,) [px] of the outlines `one` and `other`, found among every
    second point of each.
    """
    a = one[::2]
    b = other[::2]
    u, v = (a[:, None] - b).transpose(2, 0, 1)
    distance = np.hypot(u, v)
    i, j = np.unravel_index(np.argmin(distance), distance.shape)
    return a[i], b[j]
