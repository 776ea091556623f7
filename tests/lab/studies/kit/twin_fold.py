"""A simulated fold of the twin with its camera images and the truth, to measure
perception on.
"""

from dataclasses import dataclass

import numpy as np

from drivers.base.types import Array, Frame, Pose
from drivers.strip.describe import describe
from drivers.strip.engine import Touch
from drivers.strip.file import StripFile
from drivers.strip.shape import desk_contact
from drivers.twin.chain.engine import Chain
from drivers.twin.renderer.looks import PLAIN, Look, StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from drivers.twin.world import WorldState
from policies.path import Path

STEP = 0.005  # s of the plant
TIME_AFTER_TOUCH = 0.25  # s that a fold goes on after the touch
CONTACT_HEIGHT = 0.001  # m
GRIPPED_WIDTH, OPEN_WIDTH = 0.004, 0.04  # m between the fingers
TRANSPORT = 0.02  # s from an image's exposure to its arrival
HAND_ASIDE, HAND_HEIGHT = 0.05, 0.25  # m: where the hand waits while a strip is judged


@dataclass(frozen=True)
class TwinFold:
    """A simulated fold: times (k,) [s], poses (k, 3), shapes (k, n, 2), arc (n,), true
    touch.
    """

    strip: StripFile
    t: Array
    poses: Array
    shapes: Array
    arc: Array
    touch: Touch | None

    def shape(self, time: float) -> Array:
        """Midline (n, 2) [m] at `time` [s], interpolated linearly."""
        # so that another shape follows
        place = np.clip(time / STEP, 0, len(self.t) - 1.001)
        i, share = int(place), place - int(place)
        return np.asarray(
            self.shapes[i] + share * (self.shapes[i + 1] - self.shapes[i])
        )

    def pose(self, time: float) -> Pose:
        """Gripper pose at `time` [s], interpolated linearly."""
        return Pose(
            *(float(np.interp(time, self.t, self.poses[:, c])) for c in range(3))
        )

    def contact_x(self, time: float) -> float:
        """True x [m] of the desk contact at `time` [s]."""
        return desk_contact(self.shape(time), CONTACT_HEIGHT)

    def scene(self, time: float) -> WorldState:
        """Scene for the renderer at `time` [s]."""
        pose = self.pose(time)
        return WorldState(
            time, self.shape(time), self.arc, pose, GRIPPED_WIDTH, holds_strip=True
        )


def simulate_fold(
    strip: StripFile, path: Path, speed: float, *, links: int = 60
) -> TwinFold:
    """Simulate the strip along `path` at `speed` [m/s] until TIME_AFTER_TOUCH, or its
    end.
    """
    chain = Chain(links)
    chain.reset([describe(strip)])
    t, poses, shapes = [0.0], [path.poses(0.0)], [chain.shapes()[0].copy()]
    touch: Touch | None = None
    while t[-1] * speed < path.length and (
        touch is None or t[-1] < touch.time + TIME_AFTER_TOUCH
    ):
        now = t[-1] + STEP
        t.append(now)
        poses.append(path.poses(min(now * speed, path.length)))
        touch = chain.step(poses[-1][None], STEP).touch[0]
        shapes.append(chain.shapes()[0].copy())
    return TwinFold(
        strip, np.array(t), np.array(poses), np.array(shapes), chain.arc()[0], touch
    )


class FoldCamera:
    """Renders frames of a fold at any time in a look of the cell; one renderer per
    strip.
    """

    def __init__(
        self,
        strip: StripFile,
        settings: CameraSettings,
        seed: int = 0,
        look: Look = PLAIN,
    ) -> None:
        self.settings = settings
        fabric = StripLook.from_file(strip, look.pattern)
        self.renderer = Renderer(settings, fabric, seed, surround=look)

    def flat(self, strip: StripFile) -> Frame:
        """Frame of the strip flat and still before the grasp, with the hand where it
        waits.
        """
        arc = np.linspace(0, strip.length, 61)
        points = np.column_stack([arc, np.zeros_like(arc)])
        away = Pose(strip.length + HAND_ASIDE, HAND_HEIGHT, 0.0)
        scene = WorldState(0.0, points, arc, away, OPEN_WIDTH, holds_strip=False)
        return Frame(0.0, TRANSPORT, "test", 0, self.renderer.render([scene], 0))

    def frame(self, fold: TwinFold, sequence: int) -> Frame:
        """Frame number `sequence` of the fold."""
        stamp = sequence / self.settings.rate
        count = self.settings.sub_shapes
        offsets = ((np.arange(count) + 0.5) / count - 0.5) * self.settings.exposure
        scenes = [fold.scene(max(stamp + float(offset), 0.0)) for offset in offsets]
        image = self.renderer.render(scenes, sequence)
        return Frame(stamp, stamp + TRANSPORT, "test", sequence, image)
