"""Drawing of the empty cell: desk, backdrop, mark, light, and static objects on the
desk.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.polynomial.polynomial import polyfit, polyval
from numpy.typing import NDArray

from drivers.base.types import Array, Image
from drivers.franka.shapes import MARK
from drivers.strip.file import Colour
from drivers.twin.renderer.looks import Box, Cable, StripLook, Thing
from drivers.twin.renderer.optics import Optics, Pixels
from drivers.twin.settings import CameraSettings

Field = NDArray[np.float32]
BACKDROP_DISTANCE = 1.2  # m behind the near edge
MARK_SHADES = (1.1, 0.72)  # brightness of its top and of its front
SIDE_BRIGHTNESS = 0.82  # brightness of a box's sides over that of its front
FOLD_RATES = (9.0, 17.0, 29.0, 53.0)  # 1/m, of the folds of a cloth
THING_TEXTURE = 0.05  # variation of a thing's brightness, a share
CABLE_PIECES = 24  # straight pieces between two points of a cable


def bgr(colour: Colour) -> Array:
    """The sRGB `colour` as BGR floats (3,)."""
    return np.array(colour[::-1], dtype=np.float64)


def _ink(colour: Colour) -> Field:
    return bgr(colour).astype(np.float32)


def stage(
    settings: CameraSettings,
    optics: Optics,
    look: StripLook,
    rng: np.random.Generator,
    things: Sequence[Thing],
) -> Image:
    """Draw the empty cell (height, width, 3) BGR, before the lens blurs it.

    The desk is half a thickness of the strip below its midline; `things` stand on the
    desk and behind it.
    """
    width = settings.width
    around = settings.surroundings
    floor = -look.thickness / 2
    columns = np.arange(width, dtype=np.float32)
    rows = np.arange(settings.height, dtype=np.float32)
    rays = optics.rays(*np.meshgrid(columns, rows))
    canvas = _ink(around.backdrop) * _cloth(rays, settings, rng)
    behind = [thing for thing in things if depth(thing) >= around.desk_back]
    on_desk = [thing for thing in things if thing not in behind]

    _draw_things(canvas, behind, optics, rng)
    back = _row(optics, width, around.desk_back, floor)
    _cover(canvas, _desk(rays, optics, floor, settings, rng), back)

    _draw_things(canvas, on_desk, optics, rng)
    front = _row(optics, width, around.desk_front, floor)
    _cover(canvas, _ink(around.panel), front)

    lit = canvas * light(settings)[..., None]
    image: Image = np.minimum(lit + 0.5, 255).astype(np.uint8)
    _draw_mark(image, settings, optics, look)
    return image


def light(settings: CameraSettings) -> Field:
    """Brightness (height, width) that lamp, lens and exposure leave at each pixel."""
    u = np.linspace(-0.5, 0.5, settings.width, dtype=np.float32)
    v = np.linspace(-0.5, 0.5, settings.height, dtype=np.float32)[:, None]
    gradient = 1 - settings.light_gradient * (0.8 * u + 0.6 * v)
    corner = 1 - settings.vignetting * 2 * (u * u + v * v)
    return (settings.gain * gradient * corner).astype(np.float32)


def _row(optics: Optics, width: int, y: float, z: float) -> Array:
    """Rows [px] at which a line along x at `y` and `z` [m] appears in each of the
    `width` columns of the image.
    """
    x = np.linspace(-3.0, 4.0, 1401)
    # beyond, the lens's law turns back
    x = x[np.abs(x - optics.centre[0]) < y - optics.centre[1]]
    line = optics.plane(np.insert(x[:, None], 1, z, axis=1), y)
    return np.interp(np.arange(width), line[:, 0], line[:, 1])


def _cover(canvas: Field, over: Field, row: Array) -> None:
    """Cover `canvas` in place with `over` below the pixel row that `row` gives for each
    column, with an antialiased edge.
    """
    v = np.arange(canvas.shape[0])[:, None]
    share = np.clip(v - row[None, :] + 0.5, 0.0, 1.0).astype(np.float32)[..., None]
    canvas += share * (over - canvas)


def _cloth(
    rays: tuple[Pixels, Pixels, Pixels],
    settings: CameraSettings,
    rng: np.random.Generator,
) -> Field:
    """Brightness (height, width, 1) of a hanging cloth: broad folds and a fine
    weave.
    """
    x, y, z = rays
    across = x / y * (BACKDROP_DISTANCE + settings.distance)
    up = z / y
    phases = rng.uniform(0, 2 * np.pi, len(FOLD_RATES)).tolist()
    folds = np.zeros_like(across)
    for rate, phase in zip(FOLD_RATES, phases, strict=True):
        folds += np.sin(across * rate + phase + up * (2.5 * rate / 9))
    fine = rng.standard_normal(x.shape, dtype=np.float32)
    shade = 1 + settings.texture * (0.45 * folds + 0.25 * fine)
    return shade[..., None].astype(np.float32)


def _desk(
    rays: tuple[Pixels, Pixels, Pixels],
    optics: Optics,
    floor: float,
    settings: CameraSettings,
    rng: np.random.Generator,
) -> Field:
    """Colours (height, width, 3) of the desk where rays meet it, ignoring occlusion."""
    x, y = optics.on_level(rays, floor)
    grain = cv2.GaussianBlur(
        rng.standard_normal((256, 1024), dtype=np.float32), (0, 0), 1.2
    )
    grain /= grain.std()
    mottle = cv2.remap(
        grain, x * 700, y * 60, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
    )
    shade: Field = 1 + 0.5 * settings.texture * mottle
    return _ink(settings.surroundings.desk) * shade[..., None]


def _draw_mark(
    image: Image, settings: CameraSettings, optics: Optics, look: StripLook
) -> None:
    """Draw the block that marks the strip's fixed end, and stands behind the strip,
    into `image`.
    """
    left, low, _ = MARK.low
    right, high, height = MARK.high
    top_shade, front_shade = MARK_SHADES
    floor = -look.thickness / 2
    middle = look.width / 2
    colour = bgr(settings.surroundings.clamp) * settings.gain
    corners = np.array([(left, floor), (right, floor), (right, height), (left, height)])
    front = optics.plane(corners, middle + low)
    back = optics.plane(corners[2:], middle + high)
    fill(image, hull(front, back), colour * top_shade)
    fill(image, front, colour * front_shade)


def hull(one: Array, other: Array) -> Array:
    """Convex hull (m, 2) [px] of two outlines (n, 2) [px], as of a prism's faces."""
    around: Array = cv2.convexHull(np.concatenate([one, other]).astype(np.float32))
    return around[:, 0]


def fill(image: Image, outline: Array, colour: Array) -> None:
    """Fill the convex polygon `outline` (m, 2) [px] in `image` with `colour`, in place,
    with sub-pixel corners and smooth sides.
    """
    ink = np.minimum(colour, 255).tolist()
    cv2.fillConvexPoly(image, _fixed_point(outline), ink, cv2.LINE_AA, 8)


def _fixed_point(points: Array) -> NDArray[np.int32]:
    """Copy of `points` [px] in units of 1/256 px, as OpenCV draws them."""
    return np.rint(points * 256).astype(np.int32)


def depth(thing: Thing) -> float:
    """Depth y [m] of the nearest point of `thing` in the cell frame."""
    if isinstance(thing, Box):
        return thing.low[1]
    return min(point[1] for point in thing.points)


def _draw_things(
    canvas: Field, things: Sequence[Thing], optics: Optics, rng: np.random.Generator
) -> None:
    """Draw `things` on the unlit `canvas` (height, width, 3) BGR in place, far ones
    first.
    """
    shape = canvas.shape
    for thing in sorted(things, key=depth, reverse=True):
        grain = rng.standard_normal((shape[0] // 8, shape[1] // 8), np.float32)
        shade = 1 + THING_TEXTURE * cv2.resize(grain, shape[1::-1])
        for mask, brightness in _covers(thing, optics, shape[:2]):
            material = (shade * brightness)[..., None] * _ink(thing.colour)
            cover = mask.astype(np.float32) / 255
            canvas += cover[..., None] * (material - canvas)


def _covers(
    thing: Thing, optics: Optics, size: tuple[int, ...]
) -> list[tuple[NDArray[np.uint8], float]]:
    """Mask (height, width) and brightness of each visible part of a thing, in drawing
    order.
    """
    if isinstance(thing, Cable):
        return [(_line(thing, optics, size), 1.0)]
    x0, y0, z0 = thing.low
    x1, y1, z1 = thing.high
    face = np.array([(x0, z0), (x1, z0), (x1, z1), (x0, z1)])
    near = optics.plane(face, y0)
    far = optics.plane(face, y1)
    return [(_mask(hull(near, far), size), SIDE_BRIGHTNESS), (_mask(near, size), 1.0)]


def _mask(outline: Array, size: tuple[int, ...]) -> NDArray[np.uint8]:
    mask = np.zeros(size, dtype=np.uint8)
    fill(mask, outline, np.array([255.0]))
    return mask


def _line(cable: Cable, optics: Optics, size: tuple[int, ...]) -> NDArray[np.uint8]:
    """Mask (height, width), 255 inside, of a `cable` in an image of `size` (height,
    width).
    """
    knots = np.array(cable.points)
    numbers = np.arange(len(knots))
    last = len(knots) - 1
    along = np.linspace(0, last, CABLE_PIECES * last + 1)
    fit = polyfit(numbers, knots, min(last, 3))
    smooth = polyval(along, fit).T.astype(np.float64)

    distance = np.linalg.norm(smooth.mean(axis=0) - optics.centre)
    thickness = max(round(cable.thickness * optics.focal / distance), 1)
    mask = np.zeros(size, dtype=np.uint8)
    points = _fixed_point(optics.project(smooth))
    cv2.polylines(mask, [points], False, 255, thickness, cv2.LINE_AA, 8)
    return mask
