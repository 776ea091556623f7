"""Measurement of a strip image by image, in the control loop or in a separate
process.
"""

import gc
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from math import nan
from multiprocessing.connection import Connection

import cv2
import numpy as np

from calibration.calibration import Calibration
from calibration.view import PinnedView
from cell.perception.layer_touch import LayerTouch
from cell.perception.perception import Perception
from cell.perception.preflight import PreflightCheck, check_watch, inspect
from cell.perception.region import Region, still_surroundings, without_hand
from cell.perception.strip_measurement import SeenTouch, StripMeasurement
from drivers.base.child import Child, ChildDied, SharedImage
from drivers.base.errors import Fault
from drivers.base.types import Frame, Pose
from drivers.strip.file import StripFile

START_TIMEOUT = 60.0  # s for the process to start, its libraries included
ENDED = "the process for images has ended"
# of a frame in a message: its image is in shared memory
NO_IMAGE = np.empty((0, 0, 3), np.uint8)
# above recording and display, where permitted; never real-time, since it computes all
# the time
NICE = -10
# px by which a camera that is nudged in a fold is found again, by how many patches
SEARCH_RADIUS, WATCHED_PATCHES = 12, 20


@dataclass(frozen=True, slots=True)
class ImageResult:
    """Measurement of one image, with the layers' `touch` once it is certain, the
    camera's `shift` [m] and the gap of resting layers [m].
    """

    measurement: StripMeasurement
    touch: SeenTouch | None
    shift: float = nan
    resting: float = nan


Answer = ImageResult | tuple[PreflightCheck, ...]


@dataclass(frozen=True, slots=True)
class StripInputs:
    """Calibration and strip file by which images of a fold are measured.

    Its grasped edge is to lie at x = `goal` [m].
    """

    calibration: Calibration
    strip: StripFile
    goal: float = 0.0


class Measurer:
    """Measures a strip in images, once `inspect` has learnt its colours from one."""

    def __init__(self, inputs: StripInputs) -> None:
        self._inputs = inputs
        self._perception: Perception | None = None
        self._still: PinnedView | None = None
        self._touch = LayerTouch(inputs.strip, inputs.goal)

    def inspect(self, frame: Frame) -> tuple[PreflightCheck, ...]:
        """Check the image taken before the grasp, and learn the strip's colours from
        it.
        """
        calibration = self._inputs.calibration
        strip = self._inputs.strip
        inspection = inspect(frame, calibration, strip)
        appearance = inspection.appearance
        if appearance is None:
            return inspection.checks

        self._perception = Perception(calibration, strip, appearance)
        background = appearance.scene.background.image
        surroundings = still_surroundings(calibration, strip.length)
        self._still = PinnedView.choose(background, surroundings, WATCHED_PATCHES)
        return *inspection.checks, check_watch(self._still, background)

    def measure(
        self,
        frame: Frame,
        gripper: Pose,
        *,
        touches: bool = False,
        hand: Pose | None = None,
    ) -> ImageResult:
        """Measure the strip in `frame`, taken at `gripper`; if `touches`, detect layer
        touch.

        After the release the strip ends at `gripper`, and the hand is elsewhere. Raises
        Fault `no_perception` before an accepted image.
        """
        if self._perception is None or self._still is None:
            raise Fault(
                "no_perception", "a frame came before the preflight image was accepted"
            )

        measurement = self._perception.measure(frame, gripper, hand)
        touch = self._touch.update(measurement, gripper) if touches else None
        calibration = self._inputs.calibration
        clear = without_hand(Region.whole(frame.image), calibration, gripper)
        moved = self._still.motion(frame.image, clear, SEARCH_RADIUS)
        shift = nan if moved is None else moved.largest_in_plane(calibration)
        return ImageResult(
            measurement=measurement,
            touch=touch,
            shift=shift,
            resting=self._touch.resting(),
        )


Maker = Callable[[StripInputs], Measurer]


@dataclass(frozen=True, slots=True)
class ImageTask:
    """Image `frame` to check before the grasp (`gripper` is None), or in which to
    measure the strip during a fold.

    A strip that was let go ends at `gripper`, with the `hand` elsewhere.
    """

    frame: Frame
    gripper: Pose | None = None
    touches: bool = False
    hand: Pose | None = None

    def answer(self, measurer: Measurer) -> Answer:
        """Measurement of the image by `measurer`, or preflight checks if taken before
        the grasp.
        """
        if self.gripper is None:
            return measurer.inspect(self.frame)
        return measurer.measure(
            self.frame, self.gripper, touches=self.touches, hand=self.hand
        )


class InlineReader:
    """Measures images within a cycle of the control loop, for runs on a virtual clock.

    `latency` [s] is how much earlier than its stamp an image shows the world. It is
    never busy and never fails.
    """

    busy_since: float | None = None
    failure = ""

    def __init__(self, measurer: Measurer, latency: float) -> None:
        self._measurer = measurer
        self.latency = latency
        self._result: Answer | None = None

    def submit(self, request: ImageTask, now: float) -> None:  # noqa: ARG002
        """Measure the image of `request` at once, within this call."""
        self._result = request.answer(self._measurer)

    def result(self) -> Answer | None:
        """Measurement or checks of the last image, returned once."""
        result = self._result
        self._result = None
        return result


class ProcessReader:
    """Measures images in a separate process, for runs on the wall clock.

    The process is given one image at a time, in shared memory. Nothing waits for it:
    one that hangs keeps its answer, and one that dies states its `failure`.
    `busy_since` is the time [s] at which the image being measured was submitted, None
    while idle; `latency` is as of `InlineReader`.
    """

    def __init__(self, inputs: StripInputs, maker: Maker = Measurer) -> None:
        """Start the measuring process; Fault `image_reader_dead` if it does not start
        in time.
        """
        lens = inputs.calibration.lens
        self._shape = lens.height, lens.width, 3
        self.latency = inputs.calibration.latency
        self.busy_since: float | None = None
        self.failure = ""
        self._image = SharedImage()
        self._child = Child(_read_images, inputs, maker, self._shape, self._image)

        try:
            reason = "" if self._child.receive(START_TIMEOUT) else "it does not answer"
        except ChildDied as died:
            reason = str(died)

        if reason:
            self.close()
            raise Fault(
                "image_reader_dead", f"the process for images did not start: {reason}"
            )

    def submit(self, request: ImageTask, now: float) -> None:
        """Send the image of `request` to the process; Fault `image_size` for another
        size.
        """
        image = request.frame.image
        if image.shape != self._shape:
            h, w, _ = self._shape
            raise Fault(
                "image_size", f"an image of {image.shape[:2]} pixels, not {h} x {w}"
            )
        self._image.write(image)
        self.busy_since = now
        self._child.send(replace(request, frame=replace(request.frame, image=NO_IMAGE)))

    def result(self) -> Answer | None:
        """Measurement or checks of the last image, once; None until ready or after a
        failure.
        """
        if self.failure:
            return None

        # read first, so that its last message is still received
        ends = self._child.ends
        try:
            answer: Answer | None = self._child.receive(0.0)
        except ChildDied as died:
            self.failure = ENDED if died.failure is None else str(died)
            return None

        if answer is not None:
            self.busy_since = None
        elif ends:
            self.failure = ENDED
        return answer

    def close(self) -> None:
        """End the process that measures images, and free the shared memory."""
        self._child.close()
        self._image.close()


Reader = InlineReader | ProcessReader


def _read_images(
    pipe: Connection,
    inputs: StripInputs,
    maker: Maker,
    shape: tuple[int, ...],
    image: SharedImage,
) -> None:
    """Main function of the measuring process: answers each image until `pipe` is
    closed.
    """
    _raise_priority()
    cv2.setNumThreads(1)
    measurer = maker(inputs)
    gc.freeze()
    pipe.send(True)  # it can be given an image
    while True:
        task: ImageTask = pipe.recv()
        frame = replace(task.frame, image=image.read(shape))
        pipe.send(replace(task, frame=frame).answer(measurer))


def _raise_priority() -> None:
    """Raise the priority of this process among ordinary processes, not to real time.

    A process that computes without a pause must not have real-time priority: it would
    use up what the kernel leaves to all such processes, and for 50 ms in a second none
    of them runs, the robot's included (sched_rt_runtime_us in the kernel's
    documentation).
    """
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
