"""The strip's silhouette, and its outer side in order from the desk to the gripper."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.perception.appearance import SCALE, ZERO
from drivers.types import Array, Image

SOLID = 0.35  # share of strip from which a pixel belongs to it, near the desk
SPECK = 12  # px, smaller patches are noise
BRIDGE = 45.0  # px, longest break of an edge-on strip that is bridged
SMOOTH = 4  # px along the outline to either side of which directions are averaged

Outline = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Side:
    """The outer side in order from the desk contact to the gripper: `points` (n, 2) [px] in the
    window, unit `normals` (n, 2) out of the strip; `reach` [px] is how far from the gripper point
    it ends.
    """

    points: Array
    normals: Array
    reach: float


def silhouette(levels: Image, faint: float, desk_row: int) -> Image:
    """Mask of the strip in matte `levels`: SOLID below `desk_row`, share `faint` above it.

    On the backdrop there is no shadow, and an edge-on strip is fainter than its colour.
    """
    soft = cv2.GaussianBlur(levels, (3, 3), 0)
    mask = np.empty_like(soft)
    for rows, share in ((slice(0, desk_row), faint), (slice(desk_row, None), SOLID)):
        if soft[rows].size:
            cv2.threshold(soft[rows], ZERO + SCALE * share, 255, cv2.THRESH_BINARY, mask[rows])
    return np.asarray(mask, dtype=np.uint8)


def outer_side(mask: Image, contact: Array, gripper: Array, step: int) -> Side | None:
    """Outer side of the silhouette from `contact` to `gripper` (2,) [px], a point every `step`.

    With the strip on its left the outline runs from under the contact around the fold. None
    where no body of strip is seen at the contact.
    """
    outline = _body(mask, contact, gripper)
    if outline is None:
        return None
    start = int(np.argmin(np.hypot(*(outline - contact).T)))
    ring = np.roll(outline, -start, axis=0)
    away = np.hypot(*(ring - gripper).T)
    end = int(np.argmin(away))
    if end < 3 * step:
        return None
    smooth = _smoothed(ring)
    tangent = np.roll(smooth, -2, axis=0) - np.roll(smooth, 2, axis=0)
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-9)[:, None]
    picked = np.arange(0, end + 1, step)
    normals = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    return Side(smooth[picked], normals[picked], float(away[end]))


def _smoothed(ring: Array) -> Array:
    """Moving average over 2 SMOOTH + 1 points of a closed outline (n, 2)."""
    wrapped = np.vstack([ring[-SMOOTH:], ring, ring[:SMOOTH]])
    sums = np.cumsum(np.vstack([np.zeros((1, 2)), wrapped]), axis=0)
    window = 2 * SMOOTH + 1
    return np.asarray((sums[window:] - sums[:-window]) / window)


def _body(mask: Image, contact: Array, gripper: Array) -> Array | None:
    """Outline (n, 2) of the body at the contact, counter-clockwise as seen, breaks bridged."""
    outlines = _outlines(mask)
    if not outlines:
        return None
    body = min(outlines, key=lambda o: float(np.hypot(*(o - contact).T).min()))
    others = [o for o in outlines if o is not body]
    bridged = False
    while others and np.hypot(*(body - gripper).T).min() > 6:
        nearest, here, there = min(
            ((other, *_closest(body, other)) for other in others),
            key=lambda found: float(np.hypot(*(found[1] - found[2]))),
        )
        if np.hypot(*(here - there)) > BRIDGE:
            break
        cv2.line(mask, here.tolist(), there.tolist(), 255, 1)
        others = [o for o in others if o is not nearest]
        body = np.vstack([body, nearest])
        bridged = True
    if bridged:
        outlines = _outlines(mask)
        body = min(outlines, key=lambda o: float(np.hypot(*(o - contact).T).min()))
    if len(body) < 4 * SMOOTH:
        return None
    area = cv2.contourArea(body.reshape(-1, 1, 2), oriented=True)
    return np.asarray((body if area < 0 else body[::-1]), dtype=np.float64)


def _outlines(mask: Image) -> list[Outline]:
    found, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return [outline.reshape(-1, 2) for outline in found if len(outline) >= SPECK]


def _closest(one: Outline, other: Outline) -> tuple[Outline, Outline]:
    """The two points, one of each outline, that are nearest to each other (every second one)."""
    a, b = one[::2], other[::2]
    distance = np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1))
    i, j = np.unravel_index(int(np.argmin(distance)), distance.shape)
    return a[i], b[j]
