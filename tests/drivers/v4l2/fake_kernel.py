"""A kernel with one camera, whose time stands still until it is told to go on.

Whoever lets time pass waits until the driver's thread has done all that it can at each
moment, so that tests neither sleep nor race. It does what kernels do: rewrites a buffer
that is given back, changes what was asked without an error, drops frames when it has no
buffer.
"""

import errno
import os
import select
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partialmethod

import numpy as np

from drivers.v4l2.abi import (
    PROGRESSIVE,
    Argument,
    Buffer,
    BufferFlag,
    BufferRequest,
    Capability,
    CapabilityFlag,
    Control,
    ControlFlag,
    ControlQuery,
    Format,
    FormatDescription,
    Fraction,
    FrameInterval,
    FrameSize,
    Ioctl,
    StreamParameters,
    fourcc,
)
from drivers.v4l2.camera import SOURCE, V4l2Camera
from drivers.v4l2.settings import V4l2Settings

LINK = "/dev/v4l/by-id/usb-Test_Camera-video-index0"
EPOCH = 5000.0  # s on the monotonic clock when the tests begin
DELAY = 0.008  # s from the start of an exposure until its buffer is filled
PAGE = 1 << 20
SPIN = 0.02  # s of the wall after which a wait looks again, as after a signal
STUCK = 10.0  # s of the wall
FORMATS = (
    ("YUYV", b"YUYV 4:2:2"),
    ("GREY", b"8-bit Greyscale"),
    ("MJPG", b"Motion-JPEG"),
)
MONOTONIC = BufferFlag.TIMESTAMP_MONOTONIC | BufferFlag.SOURCE_START_OF_EXPOSURE


@dataclass
class Knob:
    """A control: allowed range, value, and the name of the automatic that holds it."""

    number: int
    low: int
    high: int
    value: int
    held_by: str | None = None


def usual_knobs() -> dict[str, Knob]:
    """Controls as a USB camera has them, automatics on."""
    return {
        "Brightness": Knob(0x980900, 0, 255, 128),
        "White Balance, Automatic": Knob(0x98090C, 0, 1, 1),
        "Auto Exposure": Knob(0x9A0901, 0, 3, 3),
        "Exposure Time, Absolute": Knob(0x9A0902, 1, 5000, 157, "Auto Exposure"),
        "Exposure, Dynamic Framerate": Knob(0x9A0903, 0, 1, 1),
    }


@dataclass
class Filled:
    """A buffer that waits to be taken."""

    index: int
    sequence: int
    stamp: float
    flags: int
    size: int


@dataclass
class Memory:
    """A mapping of a buffer."""

    content: np.ndarray
    closed: Callable[[], None]

    def copy(self, length: int) -> np.ndarray:
        return self.content[:length].copy()

    def close(self) -> None:
        self.closed()


@dataclass
class Faults:
    """What goes wrong, as the test says."""

    refuse: dict[Ioctl, deque[int]] = field(default_factory=dict)
    drop: set[int] = field(default_factory=set)  # sequences, which still count
    all_dropped: bool = False
    corrupt: set[int] = field(default_factory=set)
    short: set[int] = field(default_factory=set)
    stuck: bool = False  # poll reports an error and nothing else
    ahead: float = 0.0  # s that stamps are off
    repeat: bool = False  # the counter does not move


class FakeKernel:
    """Stands in for `drivers.v4l2.device.Kernel`, and is the clock of its cell."""

    def __init__(self, width: int = 64, height: int = 48, rate: float = 60.0) -> None:
        self.size, self.rate = (width, height), rate
        self.knobs = usual_knobs()
        self.faults = Faults()
        self.plugged = True
        self.busy = False
        self.counter = 0
        self.flags = int(MONOTONIC)
        self.mapped = 0
        self.opened: set[int] = set()
        self.waits = 0
        self.jpeg: bytes | None = None
        self.field = PROGRESSIVE
        self._time = 0.0
        self._next_fd = 100
        self._gone: set[int] = set()
        self._format = fourcc("YUYV")
        self._buffers: list[np.ndarray] = []
        self._queued: deque[int] = deque()
        self._filled: deque[Filled] = deque()
        self._streaming: int | None = None
        self._exposed = 0.0
        self._rng = np.random.default_rng(0)
        self._changed = threading.Condition(threading.RLock())
        self._asleep: tuple[int | None, float] | None = None

    # The cell's clock.

    def now(self) -> float:
        return self._time

    def wait_until(self, time: float) -> None:
        """Go on to `time` [s], event by event."""
        with self._changed:
            self._settle()
            while (due := min(self._due(), time)) < time or self._time < time:
                self._time = max(due, self._time)
                self._expose()
                self._settle()

    # What tests do to the camera.

    def unplug(self) -> None:
        with self._changed:
            self.plugged = False
            self._gone |= self.opened
            self._settle()

    def plug(self) -> None:
        with self._changed:
            self.plugged, self._streaming = True, None
            self.knobs = usual_knobs()
            self._settle()

    def fail(self, request: Ioctl, *numbers: int) -> None:
        """The next calls of `request` end with these errors."""
        with self._changed:
            self.faults.refuse[request] = deque(numbers)

    # The system calls.

    def open(self, path: str) -> int:
        with self._changed:
            if path != LINK or not self.plugged:
                raise _error(errno.ENOENT)
            self._next_fd += 1
            self.opened.add(self._next_fd)
            return self._next_fd

    def close(self, fd: int) -> None:
        with self._changed:
            self.opened.remove(fd)
            if self._streaming == fd:
                self._streaming = None

    def ioctl(self, fd: int, request: Ioctl, argument: Argument) -> None:
        with self._changed:
            if fd in self._gone:
                raise _error(errno.ENODEV)
            planned = self.faults.refuse.get(request)
            if planned:
                raise _error(planned.popleft())
            getattr(self, f"_{request.name.lower()}")(fd, argument)

    def map(self, fd: int, length: int, offset: int) -> Memory:
        with self._changed:
            self.mapped += 1
            return Memory(self._buffers[offset // PAGE], self._unmap)

    def _unmap(self) -> None:
        self.mapped -= 1

    def wait(self, fd: int | None, seconds: float) -> int:
        with self._changed:
            self.waits += 1
            self._asleep = (fd, self._time + seconds)
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._awake(*self._asleep), SPIN)
            self._asleep = None
            return self._events(fd)

    sleep = partialmethod(wait, None)

    def monotonic(self) -> float:
        return EPOCH + self._time

    # Time.

    def _settle(self) -> None:
        self._changed.notify_all()
        if not self._changed.wait_for(self._settled, STUCK):
            raise AssertionError("the driver's thread neither waits nor ends")

    def _settled(self) -> bool:
        if not any(thread.name == SOURCE for thread in threading.enumerate()):
            return True
        return self._asleep is not None and not self._awake(*self._asleep)

    def _awake(self, fd: int | None, until: float) -> bool:
        return self._time >= until or self._events(fd) != 0

    def _events(self, fd: int | None) -> int:
        if fd is None:
            return 0
        if fd in self._gone or self.faults.stuck:
            return select.POLLERR
        return select.POLLIN if self._filled and self._streaming == fd else 0

    def _due(self) -> float:
        frame = float("inf") if self._streaming is None else self._exposed + DELAY
        return min(frame, float("inf") if self._asleep is None else self._asleep[1])

    def _expose(self) -> None:
        """Fill a buffer when a frame is due."""
        if self._streaming is None or self._exposed + DELAY > self._time:
            return
        stamp, number, faults = EPOCH + self._exposed, self.counter, self.faults
        self._exposed += 1.0 / self.rate
        self.counter = (number + (not faults.repeat)) % (1 << 32)
        if faults.all_dropped or number in faults.drop or not self._queued:
            return
        index = self._queued.popleft()
        size = self._paint(index) // (2 if number in faults.short else 1)
        flags = self.flags | (BufferFlag.ERROR if number in faults.corrupt else 0)
        self._filled.append(Filled(index, number, stamp + faults.ahead, flags, size))

    def _paint(self, index: int) -> int:
        if self.jpeg is None:
            content = 120 + self._rng.integers(0, 4, self._length(), dtype=np.uint8)
        else:
            content = np.frombuffer(self.jpeg, np.uint8)
        self._buffers[index][: content.size] = content
        return content.size

    def _length(self) -> int:
        return self._line() * self.size[1]

    def _line(self) -> int:
        return self.size[0] * (2 if self._format == fourcc("YUYV") else 1)

    # The requests.

    def _querycap(self, fd: int, said: Capability) -> None:
        said.driver, said.card, said.bus_info = b"fake", b"Test Camera", b"usb-1"
        said.device_caps = CapabilityFlag.VIDEO_CAPTURE | CapabilityFlag.STREAMING
        said.capabilities = CapabilityFlag.DEVICE_CAPS | said.device_caps

    def _enum_fmt(self, fd: int, said: FormatDescription) -> None:
        if said.index >= len(FORMATS):
            raise _error(errno.EINVAL)
        code, said.description = FORMATS[said.index]
        said.pixelformat = fourcc(code)

    def _enum_framesizes(self, fd: int, said: FrameSize) -> None:
        if said.index > 0:
            raise _error(errno.EINVAL)
        said.type = 1
        said.steps[0], said.steps[1] = self.size

    def _enum_frameintervals(self, fd: int, said: FrameInterval) -> None:
        if said.index > 0:
            raise _error(errno.EINVAL)
        said.type = 1
        said.steps[0] = Fraction(1, round(self.rate))

    def _s_fmt(self, fd: int, asked: Format) -> None:
        if self.busy or (self._streaming is not None and self._streaming != fd):
            raise _error(errno.EBUSY)
        pix = asked.fmt.pix
        known = {fourcc(code) for code, _ in FORMATS}
        self._format = pix.pixelformat if pix.pixelformat in known else fourcc("YUYV")
        pix.width, pix.height = self.size
        pix.pixelformat, pix.field = self._format, self.field
        pix.bytesperline, pix.sizeimage = self._line(), self._length()

    def _g_parm(self, fd: int, said: StreamParameters) -> None:
        said.parm.capture.timeperframe = Fraction(1, round(self.rate))

    _s_parm = _g_parm

    def _queryctrl(self, fd: int, said: ControlQuery) -> None:
        knobs = self.knobs
        after = said.id & ~ControlFlag.NEXT
        found = sorted((knob.number, name) for name, knob in knobs.items())
        name = next((name for number, name in found if number > after), None)
        if name is None:
            raise _error(errno.EINVAL)
        knob = knobs[name]
        said.id, said.type, said.name = knob.number, 1, name.encode()
        said.minimum, said.maximum, said.step = knob.low, knob.high, 1
        held = knob.held_by and knobs[knob.held_by].value == 3
        said.flags = ControlFlag.INACTIVE if held else 0

    def _g_ctrl(self, fd: int, said: Control) -> None:
        said.value = self._knob(said.id).value

    def _s_ctrl(self, fd: int, asked: Control) -> None:
        knob = self._knob(asked.id)
        knob.value = min(max(asked.value, knob.low), knob.high)

    def _knob(self, number: int) -> Knob:
        return next(knob for knob in self.knobs.values() if knob.number == number)

    def _reqbufs(self, fd: int, asked: BufferRequest) -> None:
        self._queued.clear()
        self._filled.clear()
        self._buffers = [np.zeros(PAGE, np.uint8) for _ in range(asked.count)]

    def _querybuf(self, fd: int, said: Buffer) -> None:
        said.length, said.m.offset = PAGE, said.index * PAGE

    def _qbuf(self, fd: int, buffer: Buffer) -> None:
        buffer.sequence, buffer.flags, buffer.timestamp.seconds = 0, 0, 0
        self._buffers[buffer.index][:] = 0  # a camera may write into it from now on
        self._queued.append(buffer.index)

    def _dqbuf(self, fd: int, buffer: Buffer) -> None:
        if not self._filled:
            raise _error(errno.EAGAIN)
        filled = self._filled.popleft()
        buffer.index, buffer.sequence = filled.index, filled.sequence
        buffer.flags, buffer.bytesused = filled.flags, filled.size
        seconds, part = divmod(filled.stamp, 1)
        stamp = buffer.timestamp
        stamp.seconds, stamp.microseconds = int(seconds), int(part * 1e6)

    def _streamon(self, fd: int, _: object) -> None:
        self._streaming, self._exposed = fd, self._time
        self._filled.clear()

    def _streamoff(self, fd: int, _: object) -> None:
        self._streaming = None


@contextmanager
def connected(kernel: FakeKernel, **changed: object) -> Iterator[V4l2Camera]:
    """Its camera at 64 x 48 and 60 Hz unless `changed`, which leaves nothing held."""
    usual = {"device": LINK, "width": 64, "height": 48, "rate": 60.0}
    settings = V4l2Settings.model_validate({**usual, **changed})
    camera = V4l2Camera(settings, kernel, kernel)
    try:
        camera.connect()
        yield camera
    finally:
        camera.close()
        assert (kernel.opened, kernel.mapped) == (set(), 0)


def _error(number: int) -> OSError:
    return OSError(number, os.strerror(number))
