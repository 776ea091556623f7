"""Light in rendered frames: soft shadows of strip and arm, and mains flicker."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base.types import Array, Image
from drivers.twin.renderer.gripper import Outline
from drivers.twin.renderer.looks import Flicker, Lamp, StripLook
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.ribbon import ExposedMidline
from drivers.twin.renderer.stage import BACKDROP_DISTANCE
from drivers.twin.settings import CameraSettings

# m of x that the table of the shadow covers: more than any strip
TABLE_RANGE = (-0.2, 1.2)
BINS = 1400
# px beside the image, up to which desk counts for the rows of the shadow
IMAGE_MARGIN = 50
FADE_HEIGHT = 0.03  # m of height over which the shadow fades
SOFT_BORDER = 0.004  # m, half of its soft border in y
SHADOW_GRID = 4  # px: the grid on which a shadow is drawn
FRACTION_BITS = 4  # of the corners, which OpenCV takes as integers
# of such corners: an outline that reaches farther out is cut off there
FARTHEST = 2**20
BELOW_LAMP = 0.05  # m below the lamp at least, to cast a shadow on the desk
WALL_EDGE = -0.03  # m of height under which the desk hides the wall
Gain = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class ShadowBand:
    """Image rows, from `top` on, in which the desk under the strip appears.

    `bins` (rows, width) are the pixels' places along x, `weight` (rows, width) their
    shares of the shadow.
    """

    top: int
    bins: NDArray[np.int32]
    weight: NDArray[np.float32]

    def cast(self, image: Image, origin: tuple[int, int], profile: Array) -> None:
        """Darken the desk in `image`, whose first pixel in the frame is `origin` (u,
        v), by the shadow `profile` along x, in place.
        """
        top = self.top
        u, v = origin
        height, width, _ = image.shape
        first = max(top, v)
        end = min(top + len(self.bins), v + height)
        if first >= end:
            return

        here = slice(first - top, end - top), slice(u, u + width)
        dark = self.weight[here] * profile.astype(np.float32)[self.bins[here]]
        part = image[first - v : end - v]
        part[:] = part * (1 - dark[..., None])


def shadow_band(
    settings: CameraSettings, optics: Optics, look: StripLook
) -> ShadowBand:
    """Image rows in which the camera sees the desk at the depths y of a strip of this
    `look`.
    """
    floor = -look.thickness / 2
    top, bottom = _band_rows(settings, optics, look.width, floor)
    u, v = np.meshgrid(
        np.arange(settings.width, dtype=np.float32),
        np.arange(top, bottom, dtype=np.float32),
    )
    at_x, at_y = optics.on_level(optics.rays(u, v), floor)
    inside = np.minimum(at_y, look.width - at_y) / SOFT_BORDER
    weight = np.clip(0.5 + 0.5 * inside, 0, 1) * settings.shadow
    return ShadowBand(top, _bins(at_x), weight.astype(np.float32))


def _band_rows(
    settings: CameraSettings, optics: Optics, width: float, floor: float
) -> tuple[int, int]:
    """First and last row (exclusive) of the image in which a strip of `width` [m] casts
    its shadow on the desk at z = `floor` [m].
    """
    x = np.linspace(*TABLE_RANGE, 15)
    line = np.column_stack([x, np.full(len(x), floor)])
    border = 2 * SOFT_BORDER
    near = optics.plane(line, -border)
    far = optics.plane(line, width + border)
    u, v = np.concatenate([near, far]).T
    seen = v[(u > -IMAGE_MARGIN) & (u < settings.width + IMAGE_MARGIN)]
    top = int(np.clip(seen.min() - 1, 0, settings.height - 1))
    return top, int(np.clip(seen.max() + 2, top + 1, settings.height))


def _bins(x: NDArray[np.floating]) -> NDArray[np.int32]:
    """Indices of the bins of the shadow's table at `x` [m], in the same shape; beyond
    the table those of its end bins.
    """
    low, high = TABLE_RANGE
    bins = (x - low) / (high - low) * BINS
    numbers: NDArray[np.int32] = np.clip(bins, 0, BINS - 1).astype(np.int32)
    return numbers


def shadow_profile(curve: ExposedMidline) -> Array:
    """Darkness (BINS,) of the strip's shadow, 0 to 1, in each of BINS bins along x: the
    lower the strip hangs, the darker.
    """
    x, z = curve.points.T
    darkness = np.zeros(BINS)
    np.maximum.at(darkness, _bins(x), np.exp(-np.maximum(z, 0) / FADE_HEIGHT))
    soft: Array = cv2.blur(darkness[None, :], (7, 1))[0]
    return soft


def scale_brightness(image: Image, gain: Gain) -> Image:
    """Copy of `image` (h, w, 3) times the brightness `gain` (h, w) or (h, 1)."""
    factor = np.ascontiguousarray(np.broadcast_to(gain, image.shape[:2]))
    scaled: Image = cv2.multiply(image, cv2.merge([factor] * 3), dtype=cv2.CV_8U)
    return scaled


def flicker(light: Flicker, height: int, stamp: float, exposure: float) -> Gain:
    """Brightness factor (height, 1) of each row of a frame exposed about `stamp` [s]
    under the flickering `light`.

    The light dims by its `depth` twice a mains period; the average over an `exposure`
    [s] follows the sinc of its fraction of half that period.
    """
    rate = 2 * light.mains
    rows = stamp + light.readout * (np.arange(height) / height - 0.5)
    swing = np.sinc(rate * exposure) * np.cos(2 * np.pi * rate * rows)
    gain = 1 - light.depth * (0.5 - 0.5 * swing)
    return gain.astype(np.float32)[:, None]


def arm_shadow(
    lamp: Lamp,
    parts: Sequence[Outline],
    optics: Optics,
    size: tuple[int, int],
    floor: float,
) -> Gain:
    """Brightness factor (height, width) of each pixel of a frame under the arm's shadow
    on wall and desk.

    `size` is (width, height). The desk is at z = `floor` [m]. Objects between desk and
    wall are shaded like the wall.
    """
    width = size[0] // SHADOW_GRID
    height = size[1] // SHADOW_GRID
    dark = np.zeros((height, width), dtype=np.uint8)
    for part in parts:
        middle = (part.front + part.back) / 2
        points = np.insert(part.corners, 1, middle, axis=1)
        for shadow in (_cast_on_wall(points, lamp), _cast_on_desk(points, lamp, floor)):
            if len(shadow) > 2:
                pixels = optics.project(shadow) / SHADOW_GRID
                corners = np.rint(pixels * 2**FRACTION_BITS)
                outline = np.clip(corners, -FARTHEST, FARTHEST).astype(np.int32)
                cv2.fillPoly(dark, [outline], 255, cv2.LINE_AA, FRACTION_BITS)

    # sigma [px] of the shadow's border on the wall, from the lamp's size
    reach = BACKDROP_DISTANCE - lamp.position[1]
    border = lamp.size * BACKDROP_DISTANCE / (reach - BACKDROP_DISTANCE)
    sigma = border * optics.focal / (BACKDROP_DISTANCE - optics.centre[1]) / SHADOW_GRID
    soft = cv2.GaussianBlur(dark.astype(np.float32) / 255, (0, 0), sigma)
    gain: Gain = cv2.resize(1 - lamp.share * soft, size)
    return gain


def _cast_on_wall(points: Array, lamp: Lamp) -> Array:
    """Shadows (n, 3) [m] that `points` (n, 3), behind the lamp, cast on the visible
    wall.

    Those below the wall's visible edge are raised to it.
    """
    source = np.array(lamp.position)
    ratio = (BACKDROP_DISTANCE - source[1]) / (points[:, 1] - source[1])
    shadow: Array = source + ratio[:, None] * (points - source)
    shadow[:, 2] = np.maximum(shadow[:, 2], WALL_EDGE)
    return shadow


def _cast_on_desk(points: Array, lamp: Lamp, floor: float) -> Array:
    """Shadows (m, 3) [m] on the desk of those of `points` (n, 3) [m] that are below the
    lamp.
    """
    source = np.array(lamp.position)
    low = points[points[:, 2] < source[2] - BELOW_LAMP]
    ratio = (source[2] - floor) / (source[2] - low[:, 2])
    shadow: Array = source + ratio[:, None] * (low - source)
    shadow[:, 1] = np.minimum(shadow[:, 1], BACKDROP_DISTANCE)
    return shadow
