"""One frame in, one sight of the strip out."""

from calibration.calibration import Calibration
from calibration.perception.appearance import Appearance
from calibration.perception.settings import PerceptionSettings
from calibration.perception.sight import Sight
from drivers.strip.file import StripFile
from drivers.types import Frame, Pose


class Perception:
    """Reads frames of one strip under one calibration; holds nothing between frames."""

    def __init__(
        self,
        calibration: Calibration,
        settings: PerceptionSettings,
        strip: StripFile,
        appearance: Appearance,
    ) -> None:
        self._calibration = calibration
        self._settings = settings
        self._strip = strip
        self._appearance = appearance

    def look(self, frame: Frame, gripper: Pose) -> Sight:
        """The strip in `frame`; `gripper` is the measured pose at the frame's stamp.

        Never raises for what an image shows: what is not seen is NaN with confidence 0.
        """
        raise NotImplementedError
