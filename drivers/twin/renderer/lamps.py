"""Brightness of an image under varying light: the arm's shadow, and mains flicker."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.twin.renderer.gripper import Outline
from drivers.twin.renderer.looks.look import Flicker, Lamp
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.stage import BACKDROP_DISTANCE
from drivers.types import Array, Image

SHADOW_GRID = 4  # px: the grid on which a shadow is drawn
FRACTION_BITS = 4  # of the corners that OpenCV takes as whole numbers
FARTHEST = 2**20  # of such corners: an outline that reaches farther out is cut off there
BELOW_LAMP = 0.05  # m by which what casts a shadow on the desk is lower than the lamp
WALL_EDGE = -0.03  # m of height under which the desk hides the wall
Gain = NDArray[np.float32]


def dim(image: Image, gain: Gain) -> Image:
    """`image` (h, w, 3) under light that is `gain` (h, w) or (h, 1) times as bright."""
    whole = np.ascontiguousarray(np.broadcast_to(gain, image.shape[:2]))
    return np.asarray(cv2.multiply(image, cv2.merge([whole] * 3), dtype=cv2.CV_8U))


def flicker(light: Flicker, height: int, stamp: float, exposure: float) -> Gain:
    """Brightness (height, 1) of the rows of a frame exposed about `stamp` [s].

    The lamp's power falls to zero twice a mains period; the average over an `exposure` [s] follows
    the sinc of its fraction of that period.
    """
    rate = 2 * light.mains
    rows = stamp + light.readout * (np.arange(height) / height - 0.5)
    swing = np.sinc(rate * exposure) * np.cos(2 * np.pi * rate * rows)
    return np.asarray(1 - light.depth * (0.5 - 0.5 * swing), dtype=np.float32)[:, None]


def arm_shadow(
    lamp: Lamp, parts: Sequence[Outline], optics: Optics, size: tuple[int, int], floor: float
) -> Gain:
    """Brightness (height, width) of an image under the arm's shadow on wall and desk.

    `size` is (width, height). The desk lies at `floor` [m]. Objects between desk and wall are
    shaded like the wall.
    """
    width, height = size[0] // SHADOW_GRID, size[1] // SHADOW_GRID
    dark = np.zeros((height, width), dtype=np.uint8)
    for part in parts:
        middle = (part.front + part.back) / 2
        points = np.insert(part.corners, 1, middle, axis=1)
        for shadow in (_on_wall(points, lamp), _on_desk(points, lamp, floor)):
            if len(shadow) > 2:
                _fill(dark, optics.project(shadow) / SHADOW_GRID)
    sigma = _softness(lamp, optics) / SHADOW_GRID
    soft = cv2.GaussianBlur(dark.astype(np.float32) / 255, (0, 0), sigma)
    return np.asarray(cv2.resize(1 - np.float32(lamp.share) * soft, size), dtype=np.float32)


def _fill(dark: Image, corners: Array) -> None:
    """Fill the polygon of `corners` (n, 2) [cells of the grid] in `dark` (h, w), in place."""
    whole = np.rint(corners * 2**FRACTION_BITS)
    outline = np.clip(whole, -FARTHEST, FARTHEST).astype(np.int32)
    cv2.fillPoly(dark, [outline], 255, cv2.LINE_AA, FRACTION_BITS)


def _on_wall(points: Array, lamp: Lamp) -> Array:
    """Points (n, 3) at which rays from the lamp through `points` (n, 3) meet the wall."""
    place = np.array(lamp.place)
    away = (BACKDROP_DISTANCE - place[1]) / (points[:, 1] - place[1])
    met = place + away[:, None] * (points - place)
    met[:, 2] = np.maximum(met[:, 2], WALL_EDGE)
    return np.asarray(met)


def _on_desk(points: Array, lamp: Lamp, floor: float) -> Array:
    """Points (m, 3) at which rays from the lamp through `points` (n, 3) meet the desk."""
    place = np.array(lamp.place)
    low = points[points[:, 2] < place[2] - BELOW_LAMP]
    away = (place[2] - floor) / (place[2] - low[:, 2])
    met = place + away[:, None] * (low - place)
    met[:, 1] = np.minimum(met[:, 1], BACKDROP_DISTANCE)
    return np.asarray(met)


def _softness(lamp: Lamp, optics: Optics) -> float:
    """Sigma [px] of the blur of the shadow's border on the wall, from the lamp's size."""
    reach = BACKDROP_DISTANCE - lamp.place[1]
    border = lamp.size * BACKDROP_DISTANCE / (reach - BACKDROP_DISTANCE)
    return float(border * optics.focal / (BACKDROP_DISTANCE - optics.centre[1]))
