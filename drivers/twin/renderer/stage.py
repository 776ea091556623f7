"""Static background: desk, backdrop, clamp and light, drawn once."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.twin.renderer.clutter import depth, draw_things
from drivers.twin.renderer.look import StripLook
from drivers.twin.renderer.looks.look import Thing
from drivers.twin.renderer.optics import Optics, Pixels
from drivers.twin.settings import CameraSettings, Colour
from drivers.types import Array, Image

Field = NDArray[np.float32]
BACKDROP_DISTANCE = 1.2  # m behind the near edge
CLAMP = (-0.030, -0.001, 0.008)  # m: from x, to x, height of the bar that holds the fixed edge


@dataclass(frozen=True, slots=True)
class Stage:
    """The empty cell before the lens blurs it, (height, width, 3) BGR, and the light's gradient.

    `light` (height, width) is the brightness that light and lens leave at a pixel.
    """

    image: Image
    light: Field


def bgr(colour: Colour) -> Array:
    """The sRGB `colour` as BGR floats (3,)."""
    return np.array(colour[::-1], dtype=np.float64)


def stage(
    settings: CameraSettings,
    optics: Optics,
    look: StripLook,
    rng: np.random.Generator,
    things: Sequence[Thing] = (),
) -> Stage:
    """Draw the cell without strip and gripper; the desk lies half a thickness below the midline.

    `things` stand on the desk and behind it.
    """
    around = settings.surroundings
    floor = -look.thickness / 2
    u, v = _grid(settings.width, settings.height)
    rays = optics.rays(u, v)
    canvas = bgr(around.backdrop).astype(np.float32) * _cloth(rays, settings, rng)
    back, front = (
        _row(optics, settings.width, y, floor) for y in (around.desk_back, around.desk_front)
    )
    behind = [thing for thing in things if depth(thing) >= around.desk_back]
    draw_things(canvas, behind, optics, rng)
    _cover(canvas, _desk(rays, optics, floor, settings, rng), back)
    draw_things(canvas, [thing for thing in things if thing not in behind], optics, rng)
    _cover(canvas, bgr(around.panel).astype(np.float32) * np.ones_like(canvas), front)
    glow = light(settings)
    np.minimum(canvas * glow[..., None] + 0.5, 255, out=canvas)
    image = canvas.astype(np.uint8)
    _clamp(image, settings, optics, look)
    return Stage(image, glow)


def _grid(width: int, height: int) -> tuple[Pixels, Pixels]:
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return u, v


def light(settings: CameraSettings) -> Field:
    """Brightness (height, width) that lamp, lens and exposure leave at each pixel."""
    u = np.linspace(-0.5, 0.5, settings.width, dtype=np.float32)[None, :]
    v = np.linspace(-0.5, 0.5, settings.height, dtype=np.float32)[:, None]
    gradient = 1 - settings.light_gradient * (0.8 * u + 0.6 * v)
    corner = 1 - settings.vignetting * 2 * (u * u + v * v)
    return np.asarray(settings.gain * gradient * corner, dtype=np.float32)


def _row(optics: Optics, width: int, y: float, z: float) -> Array:
    """Row (width,) [px] at each column of the image of a line along x at `y`, `z` [m]."""
    x = np.linspace(-3.0, 4.0, 1401)
    line = optics.project(np.stack([x, np.full_like(x, y), np.full_like(x, z)], axis=-1))
    return np.interp(np.arange(width), line[:, 0], line[:, 1])


def _cover(canvas: Field, over: Field, row: Array) -> None:
    """Cover `canvas` with `over` below `row` (width,) [px], in place, with an antialiased edge."""
    v = np.arange(canvas.shape[0])[:, None]
    share = np.clip(v - row[None, :] + 0.5, 0.0, 1.0).astype(np.float32)[..., None]
    canvas += share * (over - canvas)


def _cloth(
    rays: tuple[Pixels, Pixels, Pixels], settings: CameraSettings, rng: np.random.Generator
) -> Field:
    """Brightness (height, width, 1) of a hanging cloth: broad folds and a fine weave."""
    x, y, z = rays
    across = x / y * np.float32(BACKDROP_DISTANCE + settings.distance)
    phases = rng.uniform(0, 2 * np.pi, 4)
    folds = sum(
        np.sin(across * np.float32(k) + np.float32(phase) + z / y * np.float32(2.5 * k / 9))
        for k, phase in zip((9.0, 17.0, 29.0, 53.0), phases, strict=True)
    )
    fine = rng.standard_normal(x.shape, dtype=np.float32)
    shade = 1 + np.float32(settings.texture) * (np.float32(0.45) * folds + np.float32(0.25) * fine)
    return np.asarray(shade[..., None], dtype=np.float32)


def _desk(
    rays: tuple[Pixels, Pixels, Pixels],
    optics: Optics,
    floor: float,
    settings: CameraSettings,
    rng: np.random.Generator,
) -> Field:
    """Colours (height, width, 3) of the desk where rays meet it, ignoring occlusion."""
    x, y = optics.on_level(rays, floor)
    grain = cv2.GaussianBlur(rng.standard_normal((256, 1024), dtype=np.float32), (0, 0), 1.2)
    grain /= grain.std()
    mottle = cv2.remap(grain, x * 700, y * 60, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    shade = 1 + np.float32(0.5 * settings.texture) * mottle
    colour = bgr(settings.surroundings.desk).astype(np.float32)
    return np.asarray(colour * shade[..., None], dtype=np.float32)


def _clamp(image: Image, settings: CameraSettings, optics: Optics, look: StripLook) -> None:
    """Draw the bar that clamps the fixed edge, beyond the strip's end, into `image`."""
    left, right, height = CLAMP
    floor = -look.thickness / 2
    colour = bgr(settings.surroundings.clamp) * settings.gain
    corners = np.array([(left, floor), (right, floor), (right, height), (left, height)])
    back = optics.plane(corners[2:], look.width + 0.02)
    front = optics.plane(corners, -0.004)
    hull = cv2.convexHull(np.concatenate([front, back]).astype(np.float32))[:, 0]
    fill(image, hull, colour * 1.1)
    fill(image, front, colour * 0.72)


def fill(image: Image, outline: Array, colour: Array) -> None:
    """Fill a convex polygon (m, 2) [px] with sub-pixel corners and smooth sides, in place."""
    corners = np.rint(outline * 256).astype(np.int32)
    ink = tuple(float(c) for c in np.minimum(colour, 255))
    cv2.fillConvexPoly(image, corners, ink, cv2.LINE_AA, 8)
