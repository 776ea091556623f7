"""Sub-pixel positions of the strip's borders on lines across it."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.perception.levels import ZERO_LEVEL, share
from cell.perception.silhouette import Side
from cell.perception.sizes import Sizes
from drivers.types import Array, Image

Indices = NDArray[np.signedinteger[Any]]
Marks = NDArray[np.bool_]

PLATEAU = (0.55, 1.3)  # shares of strip between which its own brightness may put it


@dataclass(frozen=True, slots=True)
class Crossings:
    """Per line (n,), offsets [px] along the inward normal from the outline's point.

    `outer` is the border that faces the outside, `inner` the far side of the same band (NaN where
    it runs into another layer), `middle` its centre of mass, `strength` the share of strip at its
    strongest.
    """

    outer: Array
    inner: Array
    middle: Array
    strength: Array


def crossings(levels: Image, side: Side, band: Array, sizes: Sizes) -> Crossings:
    """Borders of the band across each point of `side` in matte `levels`.

    `band` (n,) [px] is how wide geometry says the band is there.
    """
    step = sizes.step
    offsets = np.arange(-sizes.outside, sizes.deep + step / 2, step)
    at = side.points[:, None] - offsets[None, :, None] * side.normals[:, None]
    at = at.astype(np.float32)
    sampled = cv2.remap(levels, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=ZERO_LEVEL)
    across = share(sampled)
    n, m = across.shape
    zero = int(sizes.outside / step)
    width = np.clip(band, 1.0, sizes.deep - 4.0)
    within = (offsets >= -1.0) & (offsets <= width[:, None] + 1.0)
    strength = np.where(within, across, 0).max(axis=1)
    level = 0.5 * np.clip(strength, *PLATEAU)
    rows = np.arange(n)
    peak = np.where(within, across, -1).argmax(axis=1)
    first = zero + 2 * int(1 / step)
    above = across > level[:, None]
    rise = _last_below(above, np.minimum(np.maximum(peak, 1), first + np.round(width).astype(int)))
    outer = offsets[rise] + step * _part(across, rows, rise, level)
    start = np.maximum(peak, rise + 1)
    fall = _first_below(above, start)
    found = fall < m
    last = np.minimum(fall, m - 1)
    inner = offsets[last - 1] + step * _part(across, rows, last - 1, level)
    inner = np.where(found, inner, np.nan)
    mass = np.where(within | ((offsets >= -3) & (offsets <= width[:, None] + 3)), across, 0)
    mass = np.clip(mass, 0, None)
    middle = (mass * offsets).sum(axis=1) / np.maximum(mass.sum(axis=1), 1e-6)
    return Crossings(outer, inner, middle, strength)


def _last_below(above: Marks, before: Indices) -> Indices:
    """Per row the last index under the level that comes before index `before`; 0 if none."""
    index = np.arange(above.shape[1])
    under = ~above & (index[None, :] < before[:, None])
    return np.asarray(np.where(under, index[None, :], 0).max(axis=1))


def _first_below(above: Marks, after: Indices) -> Indices:
    """Per row the first index under the level after index `after`; the length if none."""
    index = np.arange(above.shape[1])
    under = ~above & (index[None, :] > after[:, None])
    return np.asarray(np.where(under, index[None, :], above.shape[1]).min(axis=1))


def _part(across: Array, rows: Indices, left: Indices, level: Array) -> Array:
    """Share of the way from sample `left` to the next at which the level is crossed."""
    here, there = across[rows, left], across[rows, np.minimum(left + 1, across.shape[1] - 1)]
    step = there - here
    safe = np.where(np.abs(step) < 1e-6, 1e-6, step)
    return np.asarray(np.clip((level - here) / safe, 0.0, 1.0))
