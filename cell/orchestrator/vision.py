"""Vision of a run: strip measurement, layer touch and warnings from the newest camera
image.
"""

from dataclasses import dataclass, replace
from math import hypot, nan

import numpy as np

from cell.base.config.settings import MonitorLimits
from cell.base.devices.devices import ArmHistory
from cell.orchestrator.states import State
from cell.perception.image_reader import ImageResult, ImageTask, Reader
from cell.perception.strip_measurement import SeenTouch, StripMeasurement
from drivers.base.protocols import Camera
from drivers.base.types import Frame, Image, Pose

MEASURED_STATES = frozenset({State.LIFT, State.FOLD, State.TOUCHED})
RECORDED = MEASURED_STATES | {State.LAY, State.RELEASE}
IDLE_IMAGE_PERIOD = 0.1  # s between images where nothing is measured in them
MOVED_DISTANCE = 0.002  # m of gripper motion after which an image must differ
FINGER_LENGTH = 0.045  # m
STRIDE = 64  # rows from one to the next that are compared first


@dataclass(frozen=True, slots=True)
class View:
    """Newest image and strip measurement of a run; times in seconds of the cell's
    clock.

    `frame` is the newest image and `fresh` whether it arrived on this tick; `identical`
    counts the successive images that equal it byte for byte although the gripper moved.
    `measurement` is the last one, and `read` whether it is new on this tick; `touch` is
    the detected layer_touch, `doubtful_since` when confidence fell below its limit,
    None while it is good. `reading_since` is when the measurement in progress began,
    `reader_failure` why no image is measured any more. `shift` [m] is the apparent
    motion of the camera since the preflight, `moved` the number of successive images
    with one. `stale_since` is when the newest image became too old to move by, else
    None. `resting` [m] is the distance between layers that rest without a touch.
    """

    frame: Frame | None = None
    fresh: bool = False
    identical: int = 1
    measurement: StripMeasurement | None = None
    touch: SeenTouch | None = None
    doubtful_since: float | None = None
    read: bool = False
    reading_since: float | None = None
    reader_failure: str = ""
    shift: float = nan
    moved: int = 0
    stale_since: float | None = None
    resting: float = nan


class Vision:
    """Reader of the camera on each tick of a run, which in a fold has the strip
    measured in the images.
    """

    def __init__(
        self, camera: Camera, limits: MonitorLimits, reader: Reader | None
    ) -> None:
        """Read images from `camera`; `limits` hold for confidence, camera shift and
        image age.

        The `reader` measures the images; without one they are only watched.
        """
        self._camera = camera
        self._limits = limits
        self._reader = reader
        self._frozen = FrozenImages()
        self._view = View()
        self._waiting: Frame | None = None  # the newest frame to be measured

    def update(self, state: State, now: float, arm: ArmHistory) -> View:
        """Take a new image, have it measured in MEASURED_STATES, and return the view at
        `now` [s].
        """
        fresh = self._take_frame(state, arm)
        self._view = replace(self._view, fresh=fresh, read=False)
        reader = self._reader
        # which reads its checks itself
        if reader is not None and state is not State.PREFLIGHT:
            self._measure(state, now, arm, reader)
            self._view = replace(
                self._view,
                reading_since=reader.busy_since,
                reader_failure=reader.failure,
            )
        frame = self._view.frame
        stale = frame is not None and now - frame.stamp > self._limits.image_age
        if stale != (self._view.stale_since is not None):
            self._view = replace(self._view, stale_since=now if stale else None)
        return self._view

    def _take_frame(self, state: State, arm: ArmHistory) -> bool:
        """Take a camera frame newer than the last one; returns whether one arrived."""
        after = -1.0 if self._view.frame is None else self._view.frame.stamp
        if state not in MEASURED_STATES:
            after += IDLE_IMAGE_PERIOD
        frame = self._camera.read(after, timeout=0.0)
        if frame is None:
            return False
        self._waiting = frame if state in MEASURED_STATES else None
        identical = self._frozen.count(frame, arm.pose_at(frame.stamp))
        self._view = replace(self._view, frame=frame, identical=identical)
        return True

    def _measure(
        self, state: State, now: float, arm: ArmHistory, reader: Reader
    ) -> None:
        """Collect the finished measurement, if any, and begin the measurement of the
        newest frame.
        """
        while not reader.failure:
            if self._waiting is not None and reader.busy_since is None:
                frame = self._waiting.restamp(-reader.latency)
                self._waiting = None
                may_touch = state is not State.LIFT
                reader.submit(
                    ImageTask(frame, arm.pose_at(frame.stamp), may_touch), now
                )
            result = reader.result()
            if not isinstance(result, ImageResult):
                return
            self._add(result)

    def _add(self, result: ImageResult) -> None:
        """Add the measurement, touch and warnings of one image to the view."""
        measurement = result.measurement
        doubtful_since = None
        if not measurement.confidence >= self._limits.confidence:
            doubtful_since = self._view.doubtful_since
            if doubtful_since is None:
                doubtful_since = measurement.stamp
        moved = result.shift > self._limits.camera_shift
        self._view = replace(
            self._view,
            read=True,
            measurement=measurement,
            touch=result.touch,
            resting=result.resting,
            doubtful_since=doubtful_since,
            shift=result.shift,
            moved=self._view.moved + 1 if moved else 0,
        )


class FrozenImages:
    """Detector of a camera that repeats one image, which compares every frame with the
    one before.

    A camera is frozen when it repeats the same image, byte for byte, although the
    gripper has moved. Equal images of a scene at rest prove nothing: a camera without
    noise delivers them.
    """

    def __init__(self) -> None:
        self._last: Frame | None = None
        self._gripper: Pose | None = None
        self._identical = 0

    def count(self, frame: Frame, gripper: Pose) -> int:
        """Number of equal images in a row, up to `frame`, between which the gripper
        moved.

        `gripper` is the measured pose at the frame's stamp; 1 for a new image.
        """
        last = self._last
        if last is None or self._gripper is None or not _equal(last.image, frame.image):
            self._gripper = gripper
            self._identical = 1
        elif _distance(self._gripper, gripper) > MOVED_DISTANCE:
            self._identical += 1
        self._last = frame
        return self._identical


def _equal(one: Image, other: Image) -> bool:
    """Whether two images are equal; a few rows are compared first, which mostly
    suffices.
    """
    first = slice(None, None, STRIDE)
    return np.array_equal(one[first], other[first]) and np.array_equal(one, other)


def _distance(one: Pose, other: Pose) -> float:
    """Larger of the gripper's displacement [m] between poses and the arc [m] of its
    finger tips.
    """
    turn = FINGER_LENGTH * abs(one.pitch - other.pitch)
    return max(hypot(one.x - other.x, one.z - other.z), turn)
