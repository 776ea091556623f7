"""Image measurement in a separate process, so that the control loop keeps its rate."""

import ctypes
import gc
import json
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, astuple, dataclass
from io import FileIO
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Protocol

import cv2
import numpy as np

from calibration.calibration import Calibration
from cell.perception.camera_watch import Standing
from cell.perception.layer_touch import LayerTouch
from cell.perception.measurement import SeenTouch, StripMeasurement
from cell.perception.perception import Perception
from cell.perception.preflight import PreflightCheck, inspect
from cell.perception.settings import PerceptionSettings
from drivers.errors import Fault
from drivers.strip.file import StripFile
from drivers.types import Array, Frame, Pose

INSPECT, LOOK, TRACK = 0, 1, 2  # what is asked: the checks, a measurement, or one with the touch
HEADER_SIZE = 8  # numbers beside an image: request, stamp, arrival, sequence, gripper (3), answered
NUMBERS = 11  # numbers of a measurement beside its profile
SHIFT_SIZE = 1
TOUCH_SIZE = 6
MOST_POINTS = 500  # of a profile
PROFILE_START = HEADER_SIZE + NUMBERS + SHIFT_SIZE + TOUCH_SIZE + 1  # 1: the number of points
START_TIMEOUT = 60.0  # s for the process to start, its libraries included
ENDING_TIMEOUT = 1.0  # s for it to end
ENDED = "the process for images has ended"
ASK_MESSAGE, SEEN_MESSAGE, ERROR_MESSAGE = b"?", b"s", b"!"  # the last: before its text
# before what only records or shows, where this user may; never real-time, since it computes
NICE = -10


@dataclass(frozen=True, slots=True)
class Seen:
    """Results from one image; `shift` [m] is the camera's apparent motion, NaN where unknown."""

    measurement: StripMeasurement
    touch: SeenTouch | None
    shift: float = float("nan")


class Sight(Protocol):
    """Protocol of an image reader: checks the strip before a fold, then measures each image."""

    def inspect(self, frame: Frame) -> tuple[PreflightCheck, ...]:
        """Check the image taken before the grasp, and store the strip's colours for `look`."""

    def look(self, frame: Frame, gripper: Pose, *, touches: bool) -> Seen:
        """Measure the strip in `frame`; with `touches`, also detect whether its layers touch."""


@dataclass(frozen=True, slots=True)
class Subject:
    """Inputs of strip measurement that are known before a fold."""

    calibration: Calibration
    settings: PerceptionSettings
    strip: StripFile

    def shape(self) -> tuple[int, int, int]:
        """Height and width [px] of the calibrated images, and their number of channels."""
        return self.calibration.lens.height, self.calibration.lens.width, 3


class StripSight:
    """Image reader of the cell: measures `subject` once `inspect` has accepted an image."""

    def __init__(self, subject: Subject) -> None:
        self._subject = subject
        self._perception: Perception | None = None
        self._standing: Standing | None = None
        self._touch = LayerTouch(subject.settings, subject.strip)

    def inspect(self, frame: Frame) -> tuple[PreflightCheck, ...]:
        """Check the image taken before the grasp, and store the strip's colours for `look`."""
        subject = self._subject
        known = subject.calibration, subject.settings, subject.strip
        seen = inspect(frame, *known)
        if seen.appearance is None:
            return seen.checks
        self._perception = Perception(*known, seen.appearance)
        self._standing = Standing.of(seen.appearance, *known)
        return *seen.checks, self._standing.check()

    def look(self, frame: Frame, gripper: Pose, *, touches: bool) -> Seen:
        """Measure the strip in `frame`; raises Fault `no_perception` before an accepted image."""
        if self._perception is None or self._standing is None:
            raise Fault("no_perception", "images are to be read before a picture was judged")
        measurement = self._perception.look(frame, gripper)
        touch = self._touch.update(measurement, gripper) if touches else None
        return Seen(measurement, touch, self._standing.shift(frame.image, gripper))


Maker = Callable[[Subject], Sight]


class SightProcess:
    """Handle of a process that measures one image at a time, handed over by the control loop.

    Image and answer lie in shared memory, which belongs to either side in turn: a message of a few
    bytes passes it on. So nothing is torn, and nothing waits: a process that hangs keeps its answer
    and one that dies closes the pipe.
    """

    def __init__(self, subject: Subject, made: Maker = StripSight) -> None:
        """Start the process; raises Fault `image_reader_dead` where it does not start in time."""
        context = get_context("spawn")
        h, w, _ = self._shape = subject.shape()
        image: Any = context.RawArray(ctypes.c_uint8, h * w * 3)
        numbers: Any = context.RawArray(ctypes.c_double, _size())
        self._pixels = np.frombuffer(image, np.uint8).reshape(self._shape)
        self._values = np.frombuffer(numbers, np.float64)
        self._pipe, theirs = context.Pipe()
        self._checks: tuple[PreflightCheck, ...] | None = None
        self._asked: float | None = None
        self._dead = ""
        self._process = context.Process(
            target=serve, args=(subject, made, theirs, image, numbers),
            name="images", daemon=True,
        )  # fmt: skip
        self._process.start()
        theirs.close()
        self._memory = FileIO(f"/proc/{self._process.pid}/statm")
        if not self._pipe.poll(START_TIMEOUT) or self._receive() is None:
            self.close()
            raise Fault("image_reader_dead", f"the process for images did not start: {self._dead}")

    @property
    def since(self) -> float | None:
        """Time [s] at which the image being measured was handed over; None while idle."""
        return self._asked

    @property
    def dead(self) -> str:
        """Reason why the process no longer measures images; empty while it works."""
        return self._dead

    @property
    def process(self) -> int | None:
        """ID of the process that measures images."""
        return self._process.pid

    def ask(self, request: int, frame: Frame, gripper: Pose, now: float) -> None:
        """Hand over `frame` to the idle process at `now` [s].

        Raises Fault `image_size` for an image of another size than the calibrated ones.
        """
        if frame.image.shape != self._shape:
            h, w, _ = self._shape
            raise Fault("image_size", f"an image of {frame.image.shape[:2]} pixels, not {h} x {w}")
        np.copyto(self._pixels, frame.image)
        stamps = (frame.stamp, frame.arrival, frame.sequence)
        pose = (gripper.x, gripper.z, gripper.pitch)
        self._values[:HEADER_SIZE] = (request, *stamps, *pose, 0.0)
        self._asked = now
        try:
            self._pipe.send_bytes(ASK_MESSAGE)
        except OSError:
            self._dead = self._dead or ENDED

    def answer(self) -> Seen | None:
        """Results from the image handed over last, returned once; None until they are ready."""
        return _unpack(self._values) if self._next_message() == SEEN_MESSAGE else None

    def checks(self) -> tuple[PreflightCheck, ...] | None:
        """Preflight checks of the image handed over last, returned once; None until ready.

        Raises Fault `image_reader_dead` where the process has ended.
        """
        message = self._next_message()
        if self._dead:
            raise Fault("image_reader_dead", self._dead)
        if not message:
            return None
        return tuple(PreflightCheck(**check) for check in json.loads(message))

    def close(self) -> None:
        """End the process; may be called twice."""
        self._pipe.close()
        self._memory.close()
        self._process.join(ENDING_TIMEOUT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(ENDING_TIMEOUT)

    def _next_message(self) -> bytes:
        """Next message of the process; empty while there is none."""
        if self._dead:
            return b""
        ends = self._ends()  # looked at first: what it said before that is still heard
        if self._pipe.poll(0):
            return self._receive() or b""
        self._dead = ENDED if ends else ""
        return b""

    def _ends(self) -> bool:
        """Whether the process has ended or is about to end.

        A killed one first frees its memory, for some 10 ms, and only then closes its pipe.
        """
        try:
            return os.pread(self._memory.fileno(), 64, 0).startswith(b"0 ")
        except OSError:
            return True

    def _receive(self) -> bytes | None:
        try:
            message = self._pipe.recv_bytes()
        except (EOFError, OSError):
            self._dead = ENDED
            return None
        self._asked = None
        if message[:1] == ERROR_MESSAGE:
            self._dead = message[1:].decode(errors="replace")
            return None
        return message


def serve(subject: Subject, made: Maker, pipe: Connection, image: Any, numbers: Any) -> None:
    """Main loop of the process: measures each image handed over until `pipe` is closed.

    `image` and `numbers` are the shared memory.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the cell decides when this ends
    _go_first()
    cv2.setNumThreads(1)
    sight, pixels = made(subject), np.frombuffer(image, np.uint8).reshape(subject.shape())
    pixels.setflags(write=False)
    values = np.frombuffer(numbers, np.float64)
    gc.freeze()
    try:
        pipe.send_bytes(b"ready")
        while pipe.recv_bytes():
            pipe.send_bytes(_measure(sight, pixels, values))
    except (EOFError, OSError):
        return
    except Exception as error:  # noqa: BLE001  an edge: the loop stops the arm, and says why
        pipe.send_bytes(ERROR_MESSAGE + f"{type(error).__name__}: {error}".encode())


def _go_first() -> None:
    """Raise the priority of this process among ordinary processes, not to real time.

    A process that computes without a pause must not have real-time priority: it would use up what
    the kernel leaves to all such processes, and for 50 ms in a second none of them runs, the
    robot's included (sched_rt_runtime_us in the kernel's documentation).
    """
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)


def _measure(sight: Sight, pixels: Any, values: Array) -> bytes:
    """Process the image handed over and return the message for the control loop."""
    request, stamp, arrival, sequence, x, z, pitch, _ = values[:HEADER_SIZE].tolist()
    frame = Frame(stamp, arrival, "shared", int(sequence), pixels)
    if request == INSPECT:
        checks = [asdict(check) for check in sight.inspect(frame)]
        return json.dumps(checks, default=np.generic.item).encode()
    _pack(values, sight.look(frame, Pose(x, z, pitch), touches=request == TRACK))
    return SEEN_MESSAGE


def _size() -> int:
    return PROFILE_START + 2 * MOST_POINTS


def _pack(values: Array, seen: Seen) -> None:
    """Write `seen` into the shared numbers (n,): the measurement, the touch or NaN, the profile."""
    m = seen.measurement
    points = m.profile[:MOST_POINTS]
    confidences = (m.contact_confidence, m.profile_confidence)
    numbers = [m.stamp, m.sequence, m.contact_x, *confidences, *m.tip, m.gap, m.gap_x, *m.gripper]
    touch = [np.nan] * TOUCH_SIZE if seen.touch is None else astuple(seen.touch)
    values[HEADER_SIZE:PROFILE_START] = [*numbers, seen.shift, *touch, len(points)]
    values[PROFILE_START : PROFILE_START + 2 * len(points)] = points.ravel()


def _unpack(values: Array) -> Seen:
    """Results from an image, read from the shared numbers (n,)."""
    numbers = values[HEADER_SIZE:PROFILE_START].tolist()
    stamp, sequence, contact_x, contact_confidence, profile_confidence = numbers[:5]
    tip_x, tip_z, gap, gap_x, gripper_x, gripper_z = numbers[5:NUMBERS]
    shift, *touch, count = numbers[NUMBERS:]
    points = values[PROFILE_START : PROFILE_START + 2 * int(count)].reshape(int(count), 2).copy()
    contact, profile = (contact_x, contact_confidence), (points, profile_confidence)
    tip, gripper = (tip_x, tip_z), (gripper_x, gripper_z)
    measurement = StripMeasurement(
        stamp, int(sequence), *contact, *profile, tip, gap, gap_x, gripper
    )
    return Seen(measurement, None if np.isnan(touch[0]) else SeenTouch(*touch), shift)
