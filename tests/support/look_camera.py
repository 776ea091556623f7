"""The twin's camera before a strip in any look of the cell."""

from cell.studies.kit.twin_fold import FoldCamera
from drivers.strip.file import StripFile
from drivers.twin.renderer.look import StripLook
from drivers.twin.renderer.looks.look import Look
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings


class LookCamera(FoldCamera):
    """Renders frames of a fold in `look`."""

    def __init__(self, strip: StripFile, look: Look, settings: CameraSettings) -> None:
        self.settings = settings
        self.renderer = Renderer(settings, StripLook.of(strip, look.pattern), 0, surround=look)
