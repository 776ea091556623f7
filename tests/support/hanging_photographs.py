"""Synthetic photographs of hanging strips with known truth: fuzzy yarn on a dark
ground.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from drivers.base.geometry import arc_lengths, interpolate_columns, rotation
from drivers.base.types import Array, Image
from drivers.strip.cantilever import HangingStrip, hanging_shape, hinges

FINER = 4


@dataclass(frozen=True, slots=True)
class Scene:
    """Strip at a ledge [m] and its photograph; `height` of the picture in px.

    `cropped` is the arc that lies outside of the picture, negative: so much lies on the
    ledge.
    """

    overhang: float
    bending_length: float
    thickness: float = 0.003
    height: int = 1600
    roll: float = 0.0
    cropped: float = 0.0
    curl: float = 0.0
    noise: float = 4.0
    fuzz: int = 60


def shape(scene: Scene) -> HangingStrip:
    """True shape of the hanging strip."""
    born = np.full(len(hinges(scene.overhang)), scene.curl)
    return hanging_shape(scene.overhang, scene.bending_length, rest_curvature=born)


def photograph(scene: Scene, seed: int) -> Image:
    """Rendered picture (height, width, 3), cropped at the ledge on the left."""
    rng = np.random.default_rng(seed)
    hanging = shape(scene)
    begin = -0.2 * scene.overhang  # on the ledge
    # the rounded end adds the rest
    drawn = hanging.arc < scene.overhang - 0.5 * scene.thickness
    curve = np.vstack([(begin, 0.0), hanging.points[drawn]])
    x, z = rotation(scene.roll) @ curve.T

    margin = 4 * scene.thickness
    scale = scene.height / (np.ptp(hanging.points[:, 1]) + 2 * margin)
    left = np.interp(scene.cropped, [begin, *hanging.arc[drawn]], x)
    pixels = np.stack([(x - left) * scale - 0.5, (margin - z) * scale], axis=1)
    size = (scene.height, int((x.max() - left + 2 * margin) * scale))
    return _sensor(_yarn(pixels, scene.thickness * scale, size, scene, rng), rng)


def _yarn(
    pixels: Array,
    thickness: float,
    size: tuple[int, int],
    scene: Scene,
    rng: np.random.Generator,
) -> Array:
    """Brightness of the yarn with its strands and its fuzz."""
    image = np.full(size, 22.0, dtype=np.float32)
    image += np.linspace(0, 12, size[0], dtype=np.float32)[:, None]
    travel = arc_lengths(pixels)
    for _ in range(scene.fuzz):
        at = rng.uniform(0.1, 1.0) * travel[-1]
        root = interpolate_columns(at, travel, pixels)
        walk = np.cumsum(rng.normal(0.0, 0.12 * thickness, (12, 2)), axis=0)
        drift = np.outer(np.arange(12), rng.normal(0.0, 0.1 * thickness, 2))
        _line(image, root + walk + drift, 150.0, 1)
    cover = _cover(pixels, thickness, size)
    image += cover * (215.0 - image)
    strands = np.arange(0.5 * thickness, travel[-1], 0.6 * thickness)
    for centre in interpolate_columns(strands, travel, pixels):
        shade = centre + rng.normal(0.0, 0.05 * thickness, 2)
        _line(image, np.stack([shade, shade + 0.25 * thickness]), 185.0, 2)
    return image + rng.normal(0.0, scene.noise, size).astype(np.float32)


def _cover(pixels: Array, thickness: float, size: tuple[int, int]) -> Array:
    """Share (height, width) of each pixel that a line of `thickness` [px] covers."""
    big = np.zeros((FINER * size[0], FINER * size[1]), dtype=np.uint8)
    odd = 2 * round((thickness * FINER - 1) / 2) + 1  # an even line is half a pixel off
    _line(big, (pixels + 0.5) * FINER - 0.5, 255, odd, cv2.LINE_8)
    cover = cv2.resize(big, size[::-1], interpolation=cv2.INTER_AREA)
    return cover.astype(np.float32) / 255


def _line(
    image: Array,
    points: Array,
    level: float,
    thickness: int,
    border: int = cv2.LINE_AA,
) -> None:
    """A polyline drawn with sub-pixel corners."""
    fixed = np.rint(points * 16).astype(np.int32)
    cv2.polylines(image, [fixed], False, level, thickness, border, 4)


def _sensor(brightness: Array, rng: np.random.Generator) -> Image:
    """Blur, a bright speck, and three channels of whole numbers."""
    blurred = cv2.GaussianBlur(brightness, (0, 0), 1.2)
    place = (int(0.9 * blurred.shape[1]), int(rng.uniform(0.3, 0.6) * blurred.shape[0]))
    cv2.circle(blurred, place, 5, 190.0, -1)
    tint = np.array([0.96, 0.98, 1.0])
    return np.clip(blurred[..., None] * tint, 0, 255).astype(np.uint8)
