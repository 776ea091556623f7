"""Measurement of a strip image by image, within the control loop or in a process beside it."""

import gc
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from math import nan
from multiprocessing.connection import Connection
from typing import Any, Protocol

import cv2
import numpy as np

from calibration.calibration import Calibration
from cell.perception.camera_watch import CameraWatch
from cell.perception.layer_touch import LayerTouch
from cell.perception.measurement import SeenTouch, StripMeasurement
from cell.perception.perception import Perception
from cell.perception.preflight import PreflightCheck, inspect
from cell.perception.settings import PerceptionSettings
from drivers.child import Child, ChildDied, SharedImage
from drivers.errors import Fault
from drivers.strip.file import StripFile
from drivers.types import Frame, Pose

START_TIMEOUT = 60.0  # s for the process to start, its libraries included
ENDED = "the process for images has ended"
NO_IMAGE = np.empty((0, 0, 3), np.uint8)  # of a frame in a message: its image is in shared memory
# before what only records or shows, where this user may; never real-time, since it computes
NICE = -10


@dataclass(frozen=True, slots=True)
class ImageResult:
    """Results from one image; `shift` [m] is the camera's apparent motion, NaN where unknown."""

    measurement: StripMeasurement
    touch: SeenTouch | None
    shift: float = nan


@dataclass(frozen=True, slots=True)
class Subject:
    """Inputs of strip measurement that are known before a fold."""

    calibration: Calibration
    settings: PerceptionSettings
    strip: StripFile


class StripSight:
    """Measures the strip of `subject` once `inspect` has accepted an image of it."""

    def __init__(self, subject: Subject) -> None:
        self._known = subject.calibration, subject.settings, subject.strip
        self._perception: Perception | None = None
        self._camera: CameraWatch | None = None
        self._touch = LayerTouch(subject.settings, subject.strip)

    def inspect(self, frame: Frame) -> tuple[PreflightCheck, ...]:
        """Check the image taken before the grasp, and store the strip's colours for `look`."""
        calibration, settings, strip = self._known
        found = inspect(frame, calibration, settings, strip)
        if found.appearance is None:
            return found.checks
        self._perception = Perception(calibration, settings, strip, found.appearance)
        self._camera = CameraWatch.of(found.appearance, calibration, strip)
        return *found.checks, self._camera.check()

    def look(self, frame: Frame, gripper: Pose, *, touches: bool) -> ImageResult:
        """Measure the strip in `frame`, taken at `gripper`; with `touches`, detect layer touch too.

        Raises Fault `no_perception` before an accepted image.
        """
        if self._perception is None or self._camera is None:
            raise Fault("no_perception", "images are to be read before a picture was judged")
        measurement = self._perception.look(frame, gripper)
        touch = self._touch.update(measurement, gripper) if touches else None
        return ImageResult(measurement, touch, self._camera.shift(frame.image, gripper))


Maker = Callable[[Subject], StripSight]


class Reader(Protocol):
    """Protocol of a reader of images, which is given one at a time and answers when it is ready."""

    latency: float
    """How much earlier than its stamp an image shows the world [s]."""

    @property
    def since(self) -> float | None:
        """Time [s] at which the image being read was handed over; None while idle."""

    @property
    def dead(self) -> str:
        """Reason why the reader no longer reads images; empty while it works."""

    def inspect(self, frame: Frame, now: float) -> None:
        """Begin to check the image taken before the grasp, at `now` [s]."""

    def checks(self) -> tuple[PreflightCheck, ...] | None:
        """Preflight checks of the image handed over, returned once; None until they are ready.

        Raises Fault `image_reader_dead` where the reader has ended.
        """

    def look(self, frame: Frame, gripper: Pose, now: float, *, touches: bool) -> None:
        """Begin to measure `frame` at `now` [s], taken at `gripper`; `touches` detects touch too.

        Raises Fault `image_size` for an image of another size than the calibrated ones.
        """

    def result(self) -> ImageResult | None:
        """Results from the image handed over last, returned once; None until they are ready."""


class InlineReader:
    """Reader that measures images within the control loop's cycle, as suits a virtual clock."""

    since: float | None = None
    dead = ""

    def __init__(self, sight: StripSight, latency: float) -> None:
        self._sight, self.latency = sight, latency
        self._checks: tuple[PreflightCheck, ...] | None = None
        self._result: ImageResult | None = None

    def inspect(self, frame: Frame, now: float) -> None:  # noqa: ARG002
        """Check the image taken before the grasp."""
        self._checks = self._sight.inspect(frame)

    def checks(self) -> tuple[PreflightCheck, ...] | None:
        """Preflight checks of the last image."""
        return self._checks

    def look(self, frame: Frame, gripper: Pose, now: float, *, touches: bool) -> None:  # noqa: ARG002
        """Measure `frame`, taken at `gripper`; with `touches`, detect layer touch too."""
        self._result = self._sight.look(frame, gripper, touches=touches)

    def result(self) -> ImageResult | None:
        """Results from the last image, returned once."""
        result, self._result = self._result, None
        return result


@dataclass(frozen=True, slots=True)
class Ready:
    """First message of the process: it can be given an image."""


@dataclass(frozen=True, slots=True)
class Inspect:
    """Request to check the shared image before the grasp; `frame` is without its image."""

    frame: Frame


@dataclass(frozen=True, slots=True)
class Measure:
    """Request to measure the strip in the shared image; `frame` is without its image."""

    frame: Frame
    gripper: Pose
    touches: bool


@dataclass(frozen=True, slots=True)
class Checks:
    """Answer to `Inspect`."""

    checks: tuple[PreflightCheck, ...]


class ProcessReader:
    """Reader that measures images in a process of its own, as suits the wall clock.

    The process is given one image at a time, in shared memory. Nothing waits for it: one that hangs
    keeps its answer, and one that dies is `dead`.
    """

    def __init__(self, subject: Subject, maker: Maker = StripSight) -> None:
        """Start the process; raises Fault `image_reader_dead` where it does not start in time."""
        lens = subject.calibration.lens
        self._shape = lens.height, lens.width, 3
        self.latency = subject.calibration.latency
        self.since: float | None = None
        self.dead = ""
        self._image = SharedImage()
        self._child = Child(read_images, subject, maker, self._shape, self._image)
        try:
            reason = "" if self._child.receive(START_TIMEOUT) else "it does not answer"
        except ChildDied as died:
            reason = str(died)
        if reason:
            self.close()
            raise Fault("image_reader_dead", f"the process for images did not start: {reason}")

    @property
    def pid(self) -> int:
        """ID of the process that measures images."""
        return self._child.pid

    def inspect(self, frame: Frame, now: float) -> None:
        """Hand over the image taken before the grasp to the idle process, at `now` [s]."""
        self._hand_over(frame, now)
        self._child.send(Inspect(replace(frame, image=NO_IMAGE)))

    def checks(self) -> tuple[PreflightCheck, ...] | None:
        """Preflight checks of the image handed over, returned once; None until they are ready.

        Raises Fault `image_reader_dead` where the process has ended.
        """
        answer = self._answer()
        if self.dead:
            raise Fault("image_reader_dead", self.dead)
        return answer.checks if isinstance(answer, Checks) else None

    def look(self, frame: Frame, gripper: Pose, now: float, *, touches: bool) -> None:
        """Hand over `frame`, taken at `gripper`, to the idle process, at `now` [s].

        Raises Fault `image_size` for an image of another size than the calibrated ones.
        """
        self._hand_over(frame, now)
        self._child.send(Measure(replace(frame, image=NO_IMAGE), gripper, touches))

    def result(self) -> ImageResult | None:
        """Results from the image handed over last, returned once; None until they are ready."""
        answer = self._answer()
        return answer if isinstance(answer, ImageResult) else None

    def close(self) -> None:
        """End the process."""
        self._child.close()
        self._image.close()

    def _hand_over(self, frame: Frame, now: float) -> None:
        if frame.image.shape != self._shape:
            h, w, _ = self._shape
            raise Fault("image_size", f"an image of {frame.image.shape[:2]} pixels, not {h} x {w}")
        self._image.write(frame.image)
        self.since = now

    def _answer(self) -> Any:
        """The process's next answer; None while there is none, or once it is dead."""
        if self.dead:
            return None
        ends = self._child.ends  # looked at first: what it said before that is still heard
        try:
            answer = self._child.receive(0.0)
        except ChildDied as died:
            self.dead = ENDED if died.failure is None else str(died)
            return None
        if answer is not None:
            self.since = None
        elif ends:
            self.dead = ENDED
        return answer


def read_images(
    pipe: Connection, subject: Subject, maker: Maker, shape: tuple[int, ...], image: SharedImage
) -> None:
    """Run in the process: answer each request until the other end closes `pipe`."""
    _go_first()
    cv2.setNumThreads(1)
    sight = maker(subject)
    gc.freeze()
    pipe.send(Ready())
    while True:
        asked: Inspect | Measure = pipe.recv()
        frame = replace(asked.frame, image=image.read(shape))
        if isinstance(asked, Inspect):
            pipe.send(Checks(sight.inspect(frame)))
        else:
            pipe.send(sight.look(frame, asked.gripper, touches=asked.touches))


def _go_first() -> None:
    """Raise the priority of this process among ordinary processes, not to real time.

    A process that computes without a pause must not have real-time priority: it would use up what
    the kernel leaves to all such processes, and for 50 ms in a second none of them runs, the
    robot's included (sched_rt_runtime_us in the kernel's documentation).
    """
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
