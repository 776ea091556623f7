"""Simulated touch sessions of the homography wizard, without rendered images."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.lens import Lens
from calibration.wizard.touches import (
    TouchedPoint,
    TouchSettings,
    held_out,
    suspects,
    touch_plan,
)
from drivers.base.types import Array

SETTINGS = TouchSettings()
ARM, DISC = 1e-4, 0.1  # m, px: noise of the arm's place and of the disc's centre
# share of touches with a loose pointer, and by how much [m]
WILD, FAR = 0.1, (0.004, 0.04)
LAST = 10_000


@dataclass(frozen=True)
class Camera:
    """A camera of `lens` at `centre` (3,) [m], turned by `turn` (3, 3) from world to
    camera.
    """

    lens: Lens
    centre: Array
    turn: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "Camera":
        """Random camera before the work area, 1.4 to 2.6 m away."""
        distance, width = rng.uniform(1.4, 2.6), rng.uniform(0.72, 0.86)
        aim = np.array([rng.uniform(0.28, 0.34), 0.0, rng.uniform(0.14, 0.18)])
        up = np.radians(rng.uniform(1.5, 4.9))
        centre = aim + distance * np.array(
            [rng.uniform(-0.03, 0.03), -np.cos(up), np.sin(up)]
        )
        way = aim - centre
        ahead = way / np.linalg.norm(way)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        focal = 1280 * distance / width
        middle = rng.uniform((625, 345), (655, 375))
        distortion = (rng.uniform(-0.3, 0.05), 0.1)
        lens = Lens.pinhole((1280, 720), focal, middle, distortion)
        return cls(lens, centre, np.array([right, np.cross(ahead, right), ahead]))

    def pixels(self, places: Array, nudge: Array | None = None) -> Array:
        """(n, 2) pixels of places (n, 2) x, z in the plane, `nudge` (3,) [rad] a turn
        about the camera's own axes.
        """
        matrix = self.lens.matrix
        points = np.column_stack([places[:, 0], np.zeros(len(places)), places[:, 1]])
        turned = (points - self.centre) @ self.turn.T
        if nudge is not None:
            turned = turned + np.cross(nudge, turned)
        focal, middle = np.diag(matrix)[:2], matrix[:2, 2]
        return self.lens.distort(turned[:, :2] / turned[:, 2:] * focal + middle)


def touched(
    camera: Camera,
    rng: np.random.Generator,
    *,
    nudge: Array | None = None,
    after: int = LAST,
    mirrored: bool = False,
    wild: float = 0.0,
) -> Sequence[TouchedPoint]:
    """All touches of a session with second ones; `nudge` of the camera once `after`
    touches are made, places of an arm whose x runs the other way where `mirrored`, a
    share `wild` loose.
    """
    made: list[TouchedPoint] = []

    def touch(number: int, *, again: bool) -> None:
        pose = touch_plan(SETTINGS)[number]
        place = np.array([pose.x, pose.z])
        angle, slips = rng.uniform(0, 2 * np.pi), rng.random() < wild
        off = slips * rng.uniform(*FAR) * np.array([np.cos(angle), np.sin(angle)])
        moved = nudge if len(made) >= after else None
        pixel = camera.pixels((place + off)[None], moved)[
            0
        ] + DISC * rng.standard_normal(2)
        said = place + ARM * rng.standard_normal(2)
        said = said * (-1, 1) + (0.62, 0) if mirrored else said
        made.append(
            TouchedPoint(number, said, pixel, held_out(number, SETTINGS), again=again)
        )

    for number in range(len(touch_plan(SETTINGS))):
        touch(number, again=False)
    for number in suspects(made, camera.lens, SETTINGS):
        touch(number, again=True)
    return made
