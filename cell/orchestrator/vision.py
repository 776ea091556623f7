"""Vision of a run: from camera frames to measurement, layer touch, and doubt."""

from dataclasses import dataclass
from typing import Self

from calibration.calibration import Calibration
from calibration.perception.appearance import Appearance
from calibration.perception.layer_touch import LayerTouch
from calibration.perception.measurement import SeenTouch, StripMeasurement
from calibration.perception.perception import Perception
from calibration.perception.sanity import ImageSanity
from cell.config.settings import CellSettings
from cell.orchestrator.arm_history import ArmHistory
from cell.orchestrator.states import State
from drivers.errors import Fault
from drivers.protocols import Camera
from drivers.strip.file import StripFile
from drivers.types import Frame

MEASURED = frozenset({State.LIFT, State.FOLD, State.TOUCHED})
RECORDED = MEASURED | {State.LAY, State.RELEASE}
GLANCE = 0.1  # s between images where nothing is measured in them


@dataclass(frozen=True, slots=True)
class StripReader:
    """Reads one strip in the images of one calibrated camera, with the colours found at preflight.

    `latency` [s] is how much earlier than its stamp an image shows the world.
    """

    perception: Perception
    touch: LayerTouch
    latency: float

    @classmethod
    def of(
        cls,
        settings: CellSettings,
        strip: StripFile,
        calibration: Calibration,
        appearance: Appearance,
    ) -> Self:
        """A reader of `strip` with its appearance at preflight."""
        perception = Perception(calibration, settings.perception, strip, appearance)
        return cls(perception, LayerTouch(settings.perception, strip), calibration.latency)


@dataclass(frozen=True, slots=True)
class View:
    """Camera results so far; times in seconds of the cell's clock.

    `frame` is the newest image and `fresh` whether it arrived on this tick; `identical` counts the
    successive images that equal it byte for byte although the gripper moved. `measurement` is the
    last one read, `touch` the layer_touch once it is detected, `doubtful_since` when confidence
    fell below its limit, None while it is good.
    """

    frame: Frame | None = None
    fresh: bool = False
    identical: int = 1
    measurement: StripMeasurement | None = None
    touch: SeenTouch | None = None
    doubtful_since: float | None = None


class Vision:
    """Takes the newest frame on each tick and measures the strip in it where
    the state requires it.
    """

    def __init__(self, camera: Camera, confidence: float) -> None:
        """Read from `camera`; a measurement below `confidence` is in doubt."""
        self._camera = camera
        self._confidence = confidence
        self._sanity = ImageSanity()
        self._frame: Frame | None = None
        self._identical = 1
        self._measurement: StripMeasurement | None = None
        self._touch: SeenTouch | None = None
        self._doubtful_since: float | None = None

    def look(self, state: State, now: float, arm: ArmHistory, reader: StripReader | None) -> View:
        """The view at `now` [s] in `state`; raises Fault where images are due and unreadable."""
        fresh = self._take_frame(state, now, arm)
        if fresh and state in MEASURED and self._frame is not None:
            self._measure(self._frame, state, arm, reader)
        return View(
            self._frame,
            fresh,
            self._identical,
            self._measurement,
            self._touch,
            self._doubtful_since,
        )

    def _take_frame(self, state: State, now: float, arm: ArmHistory) -> bool:
        """Whether a frame newer than the last one arrived."""
        after = self._frame.stamp if self._frame is not None else -1.0
        after = after if state in MEASURED else after + GLANCE
        frame = self._camera.read(after, timeout=0.0)
        if frame is None:
            return False
        self._frame = frame
        self._identical = self._sanity.tell(frame, now, arm.pose_at(frame.stamp)).identical
        return True

    def _measure(
        self, frame: Frame, state: State, arm: ArmHistory, reader: StripReader | None
    ) -> None:
        if reader is None:
            raise Fault("no_perception", "images are to be read before a picture was judged")
        frame = frame.restamped(-reader.latency)
        gripper = arm.pose_at(frame.stamp)
        self._measurement = reader.perception.look(frame, gripper)
        self._note_doubt(self._measurement)
        if state is not State.LIFT:
            self._touch = reader.touch.tell(self._measurement, gripper)

    def _note_doubt(self, measurement: StripMeasurement) -> None:
        if measurement.confidence >= self._confidence:
            self._doubtful_since = None
        elif self._doubtful_since is None:
            self._doubtful_since = measurement.stamp
