"""The twin's camera before a strip in any look of the cell."""

import numpy as np

from drivers.strip.file import StripFile
from drivers.twin.renderer.look import StripLook
from drivers.twin.renderer.looks.look import Look
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.scene import Scene
from drivers.twin.settings import CameraSettings
from drivers.types import Frame, Pose
from tests.support.twin_fold import FoldCamera

BESIDE, CLEAR = 0.05, 0.25  # m: where the hand waits while a strip is judged


class LookCamera(FoldCamera):
    """Renders frames of a fold in `look`."""

    def __init__(self, strip: StripFile, look: Look, settings: CameraSettings) -> None:
        self.settings = settings
        self.renderer = Renderer(settings, StripLook.of(strip, look.pattern), 0, surround=look)

    def waiting(self, strip: StripFile) -> Frame:
        """The strip flat on the desk, the hand beside it."""
        arc = np.linspace(0, strip.length, 61)
        points = np.column_stack([arc, 0 * arc])
        hand = Pose(strip.length + BESIDE, CLEAR, 0.0)
        scene = Scene(0.0, points, arc, hand, 0.04, holds_strip=False)
        return Frame(0.0, 0.02, "test", 0, self.renderer.render([scene], 0))
