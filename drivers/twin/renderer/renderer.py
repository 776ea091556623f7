"""Renderer of the twin's camera frames."""

from collections.abc import Sequence

import numpy as np

from drivers.errors import ConfigurationError
from drivers.twin.renderer.curve import Curve, expose
from drivers.twin.renderer.gripper import (
    Outline,
    draw_hand,
    draw_pointer,
    extent,
    faces_of,
    outlines,
)
from drivers.twin.renderer.kernels import splat
from drivers.twin.renderer.lamps import arm_shadow, dim, flicker
from drivers.twin.renderer.lint import draw_lint
from drivers.twin.renderer.look import StripLook
from drivers.twin.renderer.looks.green_mat import LOOK as PLAIN
from drivers.twin.renderer.looks.look import Look
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.ribbon import PITCH, faces, near_edge, project, weave
from drivers.twin.renderer.sensor import blur, noise_bank, reach
from drivers.twin.renderer.shadow import shadow_band, shadow_profile
from drivers.twin.renderer.splat import Cloud
from drivers.twin.renderer.stage import bgr, stage
from drivers.twin.renderer.window import Window
from drivers.twin.scene import Scene
from drivers.twin.settings import CameraSettings
from drivers.types import Image, Pose, frozen

_SPECK = Scene(
    stamp=0.0,
    points=frozen(np.linspace((0.0, 0.0), (0.01, 0.0), 9)),
    arc=frozen(np.linspace(0.0, 0.01, 9)),
    gripper=Pose(0.0, 0.1, 0.0),
    finger_width=0.0,
    holds_strip=False,
)


class Renderer:
    """Draws scenes of one strip look from one camera; all randomness comes from `seed`.

    The static background is drawn once at construction. `render` is a pure function of its
    arguments.
    """

    def __init__(
        self,
        settings: CameraSettings,
        look: StripLook,
        seed: int,
        optics: Optics | None = None,
        contact_bias: float = 0.0,
        surround: Look = PLAIN,
    ) -> None:
        """Draw the background; `optics` are those of `settings` unless given.

        `contact_bias` [m] shifts the apparent desk contact, see `lint`.
        `surround` is the look of the cell about the strip, its colours over those of `settings`.
        """
        settings = apply_look(settings, surround)
        self._settings = settings
        self._surround = surround
        self._look = look
        self._optics = optics or Optics.of(settings)
        rng = np.random.default_rng((seed, 0xC0))
        empty = stage(settings, self._optics, look, rng, surround.things)
        self._sharp, self._light = empty.image, empty.light
        self._resting = blur(empty.image, settings.lens_blur)
        self._shadow = shadow_band(settings, self._optics, look)
        self._weave = weave(settings.texture, rng)
        self._noise = noise_bank(settings.width, settings.height, settings.noise, seed)
        self._colour = bgr(look.colour)
        self._gripper = bgr(settings.surroundings.gripper) * settings.gain
        self._contact_bias = contact_bias
        self._spacing = PITCH * settings.distance / settings.focal
        self.render([_SPECK], 0)  # compiles what no control loop may wait for

    def render(self, scenes: Sequence[Scene], sequence: int) -> Image:
        """Frame `sequence`, (height, width, 3) BGR, of `scenes`: moments of its exposure in order.

        Raises ConfigurationError without a scene.
        """
        if not scenes:
            raise ConfigurationError("render: scenes: none given; a frame shows at least one")
        middle = scenes[len(scenes) // 2]
        curve = expose(scenes, self._spacing) if middle.strip else None
        hand = outlines(middle, self._look.width / 2, -self._look.thickness / 2)
        image = self._resting.copy()
        self._draw_moving(image, middle, curve, hand)
        image = self._lit(image, middle, hand)
        self._noise.apply(image, sequence)
        return image

    def _draw_moving(
        self, image: Image, scene: Scene, curve: Curve | None, hand: Sequence[Outline]
    ) -> None:
        """Redraw the part of `image` (h, w, 3) in which strip and hand appear, in place."""
        clouds = () if curve is None else self._clouds(curve)
        hand_faces = faces_of(hand, self._optics)
        window = Window.around(
            [*(cloud.pixels for cloud in clouds), extent(hand_faces, scene, self._optics)],
            (self._settings.width, self._settings.height),
            reach(self._settings.lens_blur),
        )
        if window is None:
            return
        part = window.of(self._sharp).copy()
        if curve is not None:
            self._shadow.cast(part, window.origin, shadow_profile(curve))
        draw_hand(part, hand, hand_faces, window.origin, self._gripper)
        for cloud in clouds:
            splat(part, cloud.points, cloud.tint, self._colour, self._light, window.origin)
        if scene.pointer:
            draw_pointer(part, scene, self._optics.seen_from(window.origin), self._gripper)
        if curve is not None and self._contact_bias:
            self._draw_lint(part, window, scene)
        window.put(blur(part, self._settings.lens_blur), image)

    def _lit(self, image: Image, scene: Scene, hand: Sequence[Outline]) -> Image:
        """`image` (h, w, 3) under light that varies: the arm's shadow and flicker, if any."""
        surround, settings = self._surround, self._settings
        if surround.lamp is not None:
            size, floor = (settings.width, settings.height), -self._look.thickness / 2
            image = dim(image, arm_shadow(surround.lamp, hand, self._optics, size, floor))
        if surround.flicker is not None:
            gain = flicker(surround.flicker, settings.height, scene.stamp, settings.exposure)
            image = dim(image, gain)
        return image

    def _clouds(self, curve: Curve) -> tuple[Cloud, ...]:
        """Clouds of the strip's material points, far to near."""
        picture = project(curve, self._optics, self._look)
        return (
            faces(curve, picture, self._optics, self._look, self._weave),
            near_edge(curve, picture, self._look, self._weave),
        )

    def _draw_lint(self, part: Image, window: Window, scene: Scene) -> None:
        optics = self._optics.seen_from(window.origin)
        glow = float(np.median(window.of(self._light)))
        look = (self._colour * glow, self._look.thickness)
        draw_lint(part, window.of(self._sharp), scene, optics, self._contact_bias, look)


def apply_look(settings: CameraSettings, look: Look) -> CameraSettings:
    """`settings` with the colours of `look` in place of their own."""
    around = settings.surroundings.model_copy(update=dict(look.colours))
    return settings.model_copy(update={"surroundings": around})
