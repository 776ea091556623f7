"""Frames of the cell as the twin's camera sees them."""

from collections.abc import Sequence

import numpy as np

from drivers.errors import ConfigurationError
from drivers.twin.camera_settings import CameraSettings
from drivers.twin.renderer.curve import Curve, exposed
from drivers.twin.renderer.gripper import Outline, draw_hand, draw_pointer, extent, outlines
from drivers.twin.renderer.look import StripLook
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.ribbon import PITCH, faces, near_edge, weave
from drivers.twin.renderer.sensor import blurred, noise_bank, reach
from drivers.twin.renderer.shadow import shadow_band, shadow_profile
from drivers.twin.renderer.splat import Cloud, paint
from drivers.twin.renderer.stage import bgr, stage
from drivers.twin.scene import Scene
from drivers.types import Array, Image

Window = tuple[slice, slice]


class Renderer:
    """Draws scenes of one strip look before one camera; all randomness comes from `seed`.

    What stands still is drawn here, once. `render` is a pure function of its arguments.
    """

    def __init__(self, settings: CameraSettings, look: StripLook, seed: int) -> None:
        self._settings = settings
        self._look = look
        self._optics = Optics.of(settings)
        rng = np.random.default_rng((seed, 0xC0))
        empty = stage(settings, self._optics, look, rng)
        self._sharp, self._light = empty.image, empty.light
        self._resting = blurred(empty.image, settings.lens_blur)
        self._shadow = shadow_band(settings, self._optics, look)
        self._weave = weave(settings.texture, rng)
        self._noise = noise_bank(settings.width, settings.height, settings.noise, seed)
        self._colour = bgr(look.colour)
        self._gripper = bgr(settings.surroundings.gripper) * settings.gain
        self._spacing = PITCH * settings.distance / settings.focal

    def render(self, scenes: Sequence[Scene], sequence: int) -> Image:
        """Frame `sequence`, (height, width, 3) BGR, of `scenes`: moments of its exposure in order.

        Raises ConfigurationError without a scene.
        """
        if not scenes:
            raise ConfigurationError("render: scenes: none given; a frame shows at least one")
        middle = scenes[len(scenes) // 2]
        curve = exposed(scenes, self._spacing) if middle.strip else None
        clouds = () if curve is None else self._clouds(curve)
        hand = outlines(middle, self._look.width / 2, -self._look.thickness / 2)
        image = self._resting.copy()
        seen = [cloud.pixels for cloud in clouds] + [extent(hand, self._optics)]
        window = _bounds(np.concatenate(seen), self._settings, 2 * reach(self._settings.lens_blur))
        if window is not None:
            part = self._drawn(window, middle, curve, clouds, hand)
            _replace(image, window, blurred(part, self._settings.lens_blur), self._settings)
        self._noise.apply(image, sequence)
        return image

    def _clouds(self, curve: Curve) -> tuple[Cloud, ...]:
        """The strip's material, far to near."""
        parts = (faces, near_edge)
        return tuple(part(curve, self._optics, self._look, self._weave) for part in parts)

    def _drawn(
        self,
        window: Window,
        scene: Scene,
        curve: Curve | None,
        clouds: Sequence[Cloud],
        hand: list[Outline],
    ) -> Image:
        """A sharp picture of all that moves in `window`, painted far to near."""
        part = self._sharp[window].copy()
        rows, columns = window
        origin = (columns.start, rows.start)
        optics = self._optics.seen_from(origin)
        if curve is not None:
            self._shadow.cast(part, origin, shadow_profile(curve))
        draw_hand(part, hand, optics, self._gripper)
        for cloud in clouds:
            paint(part, cloud.seen_from(origin), self._colour, self._light[window])
        if scene.pointer:
            draw_pointer(part, scene, optics, self._gripper)
        return part


def _bounds(pixels: Array, settings: CameraSettings, margin: int) -> Window | None:
    """The part of the image around `pixels` (n, 2), or None where they miss it."""
    low = np.floor(pixels.min(axis=0)).astype(int) - margin
    high = np.ceil(pixels.max(axis=0)).astype(int) + margin + 1
    left, top = max(int(low[0]), 0), max(int(low[1]), 0)
    right, bottom = min(int(high[0]), settings.width), min(int(high[1]), settings.height)
    if left >= right or top >= bottom:
        return None
    return slice(top, bottom), slice(left, right)


def _replace(image: Image, window: Window, part: Image, settings: CameraSettings) -> None:
    """Put `part` into `window` but for a margin, where its blur lacked what lies beyond."""
    margin = reach(settings.lens_blur)
    rows, columns = window
    up, left = (margin if side.start > 0 else 0 for side in window)
    down = margin if rows.stop < settings.height else 0
    right = margin if columns.stop < settings.width else 0
    height, width = part.shape[:2]
    image[rows.start + up : rows.stop - down, columns.start + left : columns.stop - right] = part[
        up : height - down, left : width - right
    ]
