"""layer_touch from images: the visible gap closes and the falling fold stops."""

from calibration.perception.settings import PerceptionSettings
from calibration.perception.sight import SeenTouch, Sight
from drivers.strip.file import StripFile
from drivers.types import Pose


class LayerTouch:
    """Watches sights in order and tells layer_touch once both signals agree; never a guess."""

    def __init__(self, settings: PerceptionSettings, strip: StripFile) -> None:
        self._settings = settings
        self._strip = strip

    def tell(self, sight: Sight, gripper: Pose) -> SeenTouch | None:
        """The touch, on the frame that completes the evidence and on all later ones, else None.

        `gripper` is the measured pose at the sight's stamp. The touch's own time is earlier.
        """
        raise NotImplementedError
