"""Static objects around the strip: boxes and cables, drawn far to near."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.twin.renderer.looks.look import Box, Cable, Thing
from drivers.twin.renderer.optics import Optics
from drivers.types import Array

Canvas = NDArray[np.float32]
SIDE_BRIGHTNESS = 0.82  # brightness of a box's sides over that of its front
CARTON = 0.05  # variation of a thing's brightness, a share
CURVE = 24  # pieces that a cable's bends are drawn in


def depth(thing: Thing) -> float:
    """Depth y [m] of an object, at its nearest point."""
    if isinstance(thing, Box):
        return thing.low[1]
    return min(point[1] for point in thing.points)


def draw_things(
    canvas: Canvas, things: Sequence[Thing], optics: Optics, rng: np.random.Generator
) -> None:
    """Draw `things` on the unlit `canvas` (height, width, 3) BGR in place, far ones first."""
    for thing in sorted(things, key=depth, reverse=True):
        grain = rng.standard_normal((canvas.shape[0] // 8, canvas.shape[1] // 8), np.float32)
        shade = 1 + np.float32(CARTON) * cv2.resize(grain, canvas.shape[1::-1])
        colour = np.array(thing.colour[::-1], dtype=np.float32)
        for cover, brightness in _covers(thing, optics, canvas.shape[:2]):
            material = (shade * np.float32(brightness))[..., None] * colour
            canvas += (cover.astype(np.float32) / 255)[..., None] * (material - canvas)


def _covers(
    thing: Thing, optics: Optics, size: tuple[int, ...]
) -> list[tuple[NDArray[np.uint8], float]]:
    """Mask (height, width) and brightness of each visible part of a thing, in drawing order."""
    if isinstance(thing, Cable):
        return [(_line(thing, optics, size), 1.0)]
    (x0, y0, z0), (x1, y1, z1) = thing.low, thing.high
    face = np.array([(x0, z0), (x1, z0), (x1, z1), (x0, z1)])
    near, far = optics.plane(face, y0), optics.plane(face, y1)
    hull = cv2.convexHull(np.concatenate([near, far]).astype(np.float32))[:, 0]
    return [(_fill(hull, size), SIDE_BRIGHTNESS), (_fill(near, size), 1.0)]


def _fill(outline: Array, size: tuple[int, ...]) -> NDArray[np.uint8]:
    mask = np.zeros(size, dtype=np.uint8)
    cv2.fillConvexPoly(mask, np.rint(outline * 256).astype(np.int32), 255, cv2.LINE_AA, 8)
    return mask


def _line(cable: Cable, optics: Optics, size: tuple[int, ...]) -> NDArray[np.uint8]:
    knots = np.array(cable.points)
    at = np.linspace(0, len(knots) - 1, CURVE * (len(knots) - 1) + 1)
    smooth = np.stack([_bend(at, knots[:, c]) for c in range(3)], axis=-1)
    pixels = optics.project(smooth)
    away = float(np.linalg.norm(smooth.mean(axis=0) - optics.centre))
    thickness = max(round(cable.thickness * optics.focal / away), 1)
    mask = np.zeros(size, dtype=np.uint8)
    points = np.rint(pixels * 256).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(mask, [points], False, 255, thickness, cv2.LINE_AA, 8)
    return mask


def _bend(at: Array, values: Array) -> Array:
    """Polynomial fitted to `values` (n,) at 0, 1, ..., evaluated at the places `at` (m,)."""
    degree = min(len(values) - 1, 3)
    fit = np.polynomial.polynomial.polyfit(np.arange(len(values)), values, degree)
    return np.asarray(np.polynomial.polynomial.polyval(at, fit))
