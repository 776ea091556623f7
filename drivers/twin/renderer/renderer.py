"""Renderer of the simulated camera's frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.base.types import Array, Image, Pose, frozen
from drivers.strip.model import CONTACT_HEIGHT
from drivers.strip.shape import desk_contact
from drivers.twin.renderer import gripper, ribbon
from drivers.twin.renderer.gripper import Outline
from drivers.twin.renderer.kernels import splat
from drivers.twin.renderer.light import (
    arm_shadow,
    flicker,
    scale_brightness,
    shadow_band,
    shadow_profile,
)
from drivers.twin.renderer.looks import PLAIN, Look, StripLook
from drivers.twin.renderer.optics import Optics, blur, kernel_size, noise_bank
from drivers.twin.renderer.ribbon import Cloud, ExposedMidline
from drivers.twin.renderer.stage import bgr, fill, light, stage
from drivers.twin.settings import CameraSettings
from drivers.twin.world import WorldState

T = TypeVar("T", bound=np.generic)
Indices = NDArray[np.int_]
# m by which an abrupt end looks further along (lint) or back (glare) than one that
# lifts evenly.
ABRUPT_LINT, ABRUPT_GLARE = 0.0003, 0.0008
PILE = 0.0009  # m that it reaches over the lowest strip, more than lens and pixels blur
_SPECK = WorldState(
    stamp=0.0,
    points=frozen(np.linspace((0.0, 0.0), (0.01, 0.0), 9)),
    arc=frozen(np.linspace(0.0, 0.01, 9)),
    gripper=Pose(0.0, 0.1, 0.0),
    finger_width=0.0,
    holds_strip=False,
)


@dataclass(frozen=True, slots=True)
class Window:
    """Window of an image, from pixel `first` (2,) to before pixel `end` (2,), each as
    column and row.

    Only what lies from `kept_first` to before `kept_end` is copied back: the margin
    about it serves the blur.
    """

    first: Indices
    end: Indices
    kept_first: Indices
    kept_end: Indices

    @classmethod
    def around(cls, pixels: Array, size: tuple[int, int], margin: int) -> Self | None:
        """Window around `pixels` (2, n), columns and rows, widened by twice `margin`
        [px]; None without pixels in an image of `size` (width, height).
        """
        if pixels.size == 0:
            return None
        first = np.maximum(pixels.min(axis=1).astype(int) - 2 * margin, 0)
        end = np.minimum(pixels.max(axis=1).astype(int) + 2 * margin + 1, size)
        if (first >= end).any():
            return None
        # there is no margin at the image's own border
        kept_first = np.where(first > 0, first + margin, 0)
        kept_end = np.where(end < size, end - margin, size)
        return cls(
            first=first,
            end=end,
            kept_first=kept_first,
            kept_end=np.maximum(kept_first, kept_end),
        )

    @property
    def origin(self) -> tuple[int, int]:
        """First pixel (u, v) of the window."""
        u, v = self.first.tolist()
        return u, v

    def crop(self, image: NDArray[T]) -> NDArray[T]:
        """View of the window in `image`, of any shape (height, width, ...)."""
        return _between(image, self.first, self.end)

    def put(self, part: Image, image: Image) -> None:
        """Copy a window's content `part` (h, w, 3) into `image`, without its margin."""
        kept = _between(part, self.kept_first - self.first, self.kept_end - self.first)
        _between(image, self.kept_first, self.kept_end)[:] = kept


def _between(image: NDArray[T], first: Indices, end: Indices) -> NDArray[T]:
    """View of the part of `image` from pixel `first` (2,) to before pixel `end` (2,),
    each as column and row.
    """
    (left, top), (right, bottom) = first, end
    return image[top:bottom, left:right]


class Renderer:
    """Renderer of scenes with a strip of one appearance, for one camera, random by
    `seed` alone.

    The static background is drawn once at construction. `render` is a pure function of
    its arguments.
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

        `contact_bias` [m] shifts the apparent desk contact, see `_shift_contact`.
        `surround` is the look of the cell about the strip, its colours over those of
        `settings`.
        """
        around = settings.surroundings.model_copy(update=dict(surround.colours))
        settings = settings.model_copy(update={"surroundings": around})
        self._settings = settings
        self._surround = surround
        self._look = look
        self._optics = optics or Optics.from_settings(settings)
        rng = np.random.default_rng((seed, 0xC0))
        self._sharp = stage(settings, self._optics, look, rng, surround.things)
        self._light = light(settings)
        self._resting = blur(self._sharp, settings.lens_blur)
        self._shadow = shadow_band(settings, self._optics, look)
        self._weave = ribbon.random_weave(settings.texture, rng)
        self._noise = noise_bank(settings.width, settings.height, settings.noise, seed)
        self._colour = bgr(look.colour)
        self._gripper = bgr(settings.surroundings.gripper) * settings.gain
        self._contact_bias = contact_bias
        self._spacing = ribbon.PITCH * settings.distance / settings.focal
        self.render([_SPECK], sequence=0)  # compiles now, outside the control loop

    def render(self, scenes: Sequence[WorldState], sequence: int) -> Image:
        """Draw frame number `sequence` (height, width, 3) in BGR, during whose exposure
        the cell passes through `scenes` at equal times.
        """
        middle = scenes[len(scenes) // 2]
        curve = ribbon.expose(scenes, self._spacing) if middle.strip else None
        hand = gripper.outlines(middle, self._look.width / 2, -self._look.thickness / 2)
        image = self._resting.copy()
        self._draw_moving(image, middle, curve, hand)
        image = self._lit(image, middle, hand)
        self._noise.apply(image, sequence)
        return image

    def _draw_moving(
        self,
        image: Image,
        scene: WorldState,
        curve: ExposedMidline | None,
        hand: Sequence[Outline],
    ) -> None:
        """Redraw the part of `image` (h, w, 3) in which strip and hand appear, in
        place.
        """
        settings = self._settings
        optics = self._optics
        clouds = [] if curve is None else self._material(curve)
        hand_faces = gripper.faces_of(hand, optics)
        drawn = [cloud.points[:2] for cloud in clouds]
        drawn.append(gripper.extent(hand_faces, scene, optics).T)
        window = Window.around(
            np.concatenate(drawn, axis=1),
            (settings.width, settings.height),
            kernel_size(settings.lens_blur),
        )
        if window is None:
            return

        part = window.crop(self._sharp).copy()
        if curve is not None:
            self._shadow.cast(part, window.origin, shadow_profile(curve))

        gripper.draw_hand(part, hand, hand_faces, window.origin, self._gripper)
        for cloud in clouds:
            splat(
                part, cloud.points, cloud.tint, self._colour, self._light, window.origin
            )

        if scene.pointer:
            gripper.draw_pointer(
                part, scene, optics.seen_from(window.origin), self._gripper
            )

        if curve is not None and self._contact_bias:
            self._shift_contact(part, window, scene)

        window.put(blur(part, settings.lens_blur), image)

    def _shift_contact(self, part: Image, window: Window, scene: WorldState) -> None:
        """Draw lint or glare in `part` (h, w, 3) that shifts the apparent contact along
        x.

        Lint of the strip's colour in front of its near edge closes the wedge between
        strip and desk, so that the strip seems to leave it later. Glare of the desk
        hides the foot of the edge, so that it seems to leave it earlier. The upper
        outline stays unchanged.
        """
        if not (scene.points[:, 1] > CONTACT_HEIGHT).any():
            return
        contact = desk_contact(scene.points, CONTACT_HEIGHT)
        bias = self._contact_bias
        if bias > 0:  # lint
            left = contact - PILE
            right = contact + max(bias - ABRUPT_LINT, 0.0)
        else:  # glare
            left = contact + min(bias + ABRUPT_GLARE, 0.0)
            right = contact + PILE
        low = -self._look.thickness / 2
        high = CONTACT_HEIGHT + low + PILE
        corners = np.array([(left, low), (right, low), (right, high), (left, high)])
        outline = self._optics.seen_from(window.origin).plane(corners)

        if bias > 0:
            light = np.median(window.crop(self._light))
            fill(part, outline, ribbon.CUT * (self._colour * light))
            return
        cover = np.zeros_like(part)
        fill(cover, outline, np.full(3, 255.0))
        share = cover / 255.0
        part[:] = share * window.crop(self._sharp) + (1.0 - share) * part + 0.5

    def _material(self, curve: ExposedMidline) -> list[Cloud]:
        """Material points of a strip along `curve`: of its visible side, then of its
        near edge.
        """
        look = self._look
        picture = ribbon.project(curve, self._optics, look)
        return [
            ribbon.sample_face(curve, picture, self._optics, look, self._weave),
            ribbon.sample_edge(curve, picture, look, self._weave),
        ]

    def _lit(self, image: Image, scene: WorldState, hand: Sequence[Outline]) -> Image:
        """`image` (h, w, 3) with the arm's shadow and flicker: a copy, where the look
        has them.
        """
        surround = self._surround
        settings = self._settings
        if surround.lamp is not None:
            size = (settings.width, settings.height)
            floor = -self._look.thickness / 2
            gain = arm_shadow(
                surround.lamp, parts=hand, optics=self._optics, size=size, floor=floor
            )
            image = scale_brightness(image, gain)

        if surround.flicker is not None:
            gain = flicker(
                surround.flicker, settings.height, scene.stamp, settings.exposure
            )
            image = scale_brightness(image, gain)
        return image
