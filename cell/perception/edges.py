"""Sub-pixel positions of the strip's borders on lines across it."""

from dataclasses import dataclass

import cv2
import numpy as np

from cell.perception.kernels import borders
from cell.perception.levels import ZERO_LEVEL, share
from cell.perception.silhouette import Side
from cell.perception.sizes import Sizes
from drivers.types import Array, Image

PLATEAU = (0.55, 1.3)  # shares of strip between which its own brightness may put it
OUTLINE_ERROR = 2  # px by which the outline may lie outside the border
FAR_ROOM = 4.0  # px of a line beyond the widest band, where it falls off


@dataclass(frozen=True, slots=True)
class Crossings:
    """Borders of the strip on n lines across it, as offsets (n,) [px] along the inward normal.

    Offsets count from the outline's point. `outer` is the border that faces the outside, `inner`
    the far side of the same band (NaN where it runs into another layer), `middle` its centre of
    mass, `strength` (n,) the share of strip at its strongest.
    """

    outer: Array
    inner: Array
    middle: Array
    strength: Array


def crossings(levels: Image, side: Side, band: Array, sizes: Sizes) -> Crossings:
    """Find the strip's borders on a line across each point of `side` in matte `levels` (h, w).

    `band` (n,) [px] is how wide geometry says the band is there.
    """
    step = sizes.step
    offsets = np.arange(-sizes.outside, sizes.deep + step / 2, step)
    at = side.points[:, None] - offsets[None, :, None] * side.normals[:, None]
    at = at.astype(np.float32)
    sampled = cv2.remap(levels, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=ZERO_LEVEL)
    across = share(sampled)
    width = np.clip(band, 1.0, sizes.deep - FAR_ROOM)
    first = int(sizes.outside / step) + OUTLINE_ERROR * int(1 / step)  # sample
    latest = first + np.round(width).astype(np.int64)
    found, mass = borders(across, offsets, width, latest, PLATEAU)
    outer, inner, strength = found.T
    middle = (mass * offsets).sum(axis=1) / np.maximum(mass.sum(axis=1), 1e-6)
    return Crossings(outer, inner, middle, strength)
