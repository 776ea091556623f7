"""Measures images in a process beside the control loop, which keeps its rate whatever they cost."""

import ctypes
import gc
import json
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from io import FileIO
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Protocol

import cv2
import numpy as np

from calibration.calibration import Calibration
from cell.perception.checks import PreflightCheck
from cell.perception.layer_touch import LayerTouch
from cell.perception.measurement import SeenTouch, StripMeasurement
from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.perception.settings import PerceptionSettings
from cell.perception.standing import Standing
from drivers.errors import Fault
from drivers.strip.file import StripFile
from drivers.types import Array, Frame, Pose

INSPECT, LOOK, TRACK = 0, 1, 2  # what is asked: the checks, a measurement, or one with the touch
HEADER_SIZE = 8  # numbers beside an image: request, stamp, arrival, sequence, gripper (3), answered
NUMBERS = 11  # numbers of a measurement beside its profile
SHIFT_SIZE = 1
TOUCH_SIZE = 6
MOST_POINTS = 500  # of a profile
START_TIMEOUT = 60.0  # s for the process to start, its libraries included
ENDING_TIMEOUT = 1.0  # s for it to end
ENDED = "the process for images has ended"
NICE = (
    -10
)  # before what only records or shows, where this user may; never real-time, since it computes


@dataclass(frozen=True, slots=True)
class Seen:
    """Findings of one image; `shift` [m] is the camera's apparent motion, NaN where unknown."""

    measurement: StripMeasurement
    touch: SeenTouch | None
    shift: float = float("nan")


class Sight(Protocol):
    """Judges the strip before a fold and measures it in the images of the fold."""

    def inspect(self, frame: Frame) -> tuple[PreflightCheck, ...]:
        """Check an image before the grasp, and keep the strip's colours."""

    def look(self, frame: Frame, gripper: Pose, *, touches: bool) -> Seen:
        """Measure the strip in `frame`, and with `touches` whether its layers touch."""


@dataclass(frozen=True, slots=True)
class Subject:
    """Everything known before the fold of a strip that is to be measured."""

    calibration: Calibration
    settings: PerceptionSettings
    strip: StripFile

    def shape(self) -> tuple[int, int, int]:
        """Height and width of the calibrated images [px], and their channels."""
        return self.calibration.lens.height, self.calibration.lens.width, 3


class StripSight:
    """Measures `subject` once an image of it was accepted."""

    def __init__(self, subject: Subject) -> None:
        self._subject = subject
        self._perception: Perception | None = None
        self._standing: Standing | None = None
        self._touch = LayerTouch(subject.settings, subject.strip)

    def inspect(self, frame: Frame) -> tuple[PreflightCheck, ...]:
        """Check an image before the grasp, and keep the strip's colours."""
        s = self._subject
        seen = inspect(frame, s.calibration, s.settings, s.strip)
        if seen.appearance is None:
            return seen.checks
        self._perception = Perception(s.calibration, s.settings, s.strip, seen.appearance)
        self._standing = Standing.of(seen.appearance, s.calibration, s.settings, s.strip)
        return *seen.checks, self._standing.check()

    def look(self, frame: Frame, gripper: Pose, *, touches: bool) -> Seen:
        """Measure the strip in `frame`; Fault `no_perception` before an image was accepted."""
        if self._perception is None or self._standing is None:
            raise Fault("no_perception", "images are to be read before a picture was judged")
        measurement = self._perception.look(frame, gripper)
        touch = self._touch.update(measurement, gripper) if touches else None
        return Seen(measurement, touch, self._standing.shift(frame.image, gripper))


Maker = Callable[[Subject], Sight]


class Beside:
    """A process that measures one image at a time; the loop hands it the newest when it is free.

    Image and answer lie in shared memory, which belongs to either side in turn: a message of a few
    bytes passes it on. So nothing is torn, and nothing waits: a process that hangs keeps its answer
    and one that dies closes the pipe.
    """

    def __init__(self, subject: Subject, made: Maker = StripSight) -> None:
        """Start the process; Fault `image_reader_dead` where it does not come up in time."""
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
        """When the image under way was handed over [s]; None while nothing is."""
        return self._asked

    @property
    def dead(self) -> str:
        """Why no image is measured any more; empty while they are."""
        return self._dead

    @property
    def process(self) -> int | None:
        """Process ID."""
        return self._process.pid

    def ask(self, request: int, frame: Frame, gripper: Pose, now: float) -> None:
        """Hand over `frame` at `now` [s]; nothing may be under way. Raises Fault `image_size` for
        one that is not as large as the calibrated ones.
        """
        if frame.image.shape != self._shape:
            h, w, _ = self._shape
            raise Fault("image_size", f"an image of {frame.image.shape[:2]} pixels, not {h} x {w}")
        np.copyto(self._pixels, frame.image)
        pose = (gripper.x, gripper.z, gripper.pitch)
        self._values[:HEADER_SIZE] = (
            request,
            frame.stamp,
            frame.arrival,
            frame.sequence,
            *pose,
            0.0,
        )
        self._asked = now
        try:
            self._pipe.send_bytes(b"?")
        except OSError:
            self._dead = self._dead or ENDED

    def answer(self) -> Seen | None:
        """Findings of the image under way, None until they are known."""
        return _unpack(self._values) if self._news() == b"s" else None

    def checks(self) -> tuple[PreflightCheck, ...] | None:
        """The checks of the image under way; None until they are known.

        Raises Fault `image_reader_dead` where they never will be.
        """
        news = self._news()
        if self._dead:
            raise Fault("image_reader_dead", self._dead)
        if not news:
            return None
        return tuple(PreflightCheck(**check) for check in json.loads(news))

    def close(self) -> None:
        """End the process; calling it twice is allowed."""
        self._pipe.close()
        self._memory.close()
        self._process.join(ENDING_TIMEOUT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(ENDING_TIMEOUT)

    def _news(self) -> bytes:
        """The message of the process, empty for none."""
        if self._dead:
            return b""
        ends = self._ends()  # looked at first: what it said before that is still heard
        if self._pipe.poll(0):
            return self._receive() or b""
        self._dead = ENDED if ends else ""
        return b""

    def _ends(self) -> bool:
        """Whether the process has ended or is about to: a killed one first gives its memory back,
        for some ten milliseconds, and only then closes its pipe.
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
        if message[:1] == b"!":
            self._dead = message[1:].decode(errors="replace")
            return None
        return message


def serve(subject: Subject, made: Maker, pipe: Connection, image: Any, numbers: Any) -> None:
    """Measure what is handed over until the other end of `pipe` closes; `image` and `numbers` are
    the shared memory.
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
        pipe.send_bytes(f"!{type(error).__name__}: {error}".encode())


def _go_first() -> None:
    """Take precedence among ordinary processes.

    A process that computes without a pause must not have real-time priority: it would use up what
    the kernel leaves to all such processes, and for 50 ms in a second none of them runs, the
    robot's included (sched_rt_runtime_us in the kernel's documentation).
    """
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICE)


def _measure(sight: Sight, pixels: Any, values: Array) -> bytes:
    """Measure the image handed over, and the message that says so."""
    request, stamp, arrival, sequence, x, z, pitch, _ = values[:HEADER_SIZE].tolist()
    frame = Frame(stamp, arrival, "shared", int(sequence), pixels)
    if request == INSPECT:
        checks = [asdict(check) for check in sight.inspect(frame)]
        return json.dumps(checks, default=np.generic.item).encode()
    _pack(values, sight.look(frame, Pose(x, z, pitch), touches=request == TRACK))
    return b"s"


def _size() -> int:
    return HEADER_SIZE + NUMBERS + SHIFT_SIZE + TOUCH_SIZE + 1 + 2 * MOST_POINTS


def _pack(values: Array, seen: Seen) -> None:
    """Write `seen` into the shared numbers (n,): the measurement, the touch or NaN, the profile."""
    m, t = seen.measurement, seen.touch
    points = m.profile[:MOST_POINTS]
    one = [m.stamp, m.sequence, m.contact_x, m.contact_confidence, m.profile_confidence, *m.tip]
    one += [m.gap, m.gap_x, *m.gripper, seen.shift]
    nothing = [np.nan] * TOUCH_SIZE
    touch = nothing if t is None else [t.time, t.x, t.to_grasped, t.to_fixed, t.confidence]
    touch += [] if t is None else [t.distance]
    start = HEADER_SIZE + NUMBERS + SHIFT_SIZE + TOUCH_SIZE + 1
    values[HEADER_SIZE:start] = [*one, *touch, len(points)]
    values[start : start + 2 * len(points)] = points.ravel()


def _unpack(values: Array) -> Seen:
    """Findings of an image from the shared numbers (n,)."""
    start = HEADER_SIZE + NUMBERS + SHIFT_SIZE + TOUCH_SIZE + 1
    one, touch = values[HEADER_SIZE:start].tolist(), None
    stamp, sequence, contact_x, contact, profile, tip_x, tip_z, gap, gap_x, x, z = one[:NUMBERS]
    count = int(one[-1])
    touching = one[NUMBERS + SHIFT_SIZE : -1]
    if not np.isnan(touching[0]):
        touch = SeenTouch(*touching)
    points = values[start : start + 2 * count].reshape(count, 2).copy()
    tip = (tip_x, tip_z)
    measurement = StripMeasurement(
        stamp, int(sequence), contact_x, contact, points, profile, tip, gap, gap_x, (x, z)
    )
    return Seen(measurement, touch, one[NUMBERS])
