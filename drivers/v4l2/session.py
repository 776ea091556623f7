"""A V4L2 camera that is open, configured and streaming: its frames with time of
exposure, number and counts of lost ones.
"""

import errno
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

from drivers.base.types import Frame, Image
from drivers.v4l2.abi import (
    CAPTURE,
    MMAP,
    Buffer,
    BufferFlag,
    BufferRequest,
    Ioctl,
    Number,
)
from drivers.v4l2.controls import EXPOSURE, EXPOSURE_UNIT, controls_of, lock
from drivers.v4l2.device import (
    CameraFaulty,
    CameraLost,
    Device,
    Kernel,
    MappedBuffer,
    translated,
)
from drivers.v4l2.formats import PictureFormat, negotiate
from drivers.v4l2.settings import V4l2Settings

FEWEST_BUFFERS = 2
MICRO = 1e-6
OLDEST = 2.0  # s; a stamp further back is not of this frame
BITS = 1 << 32


class StampSource(StrEnum):
    """Sources of a frame's stamp: the kernel's time of the exposure's start or end, or
    the time of dequeueing.
    """

    START = "start of exposure"
    END = "end of exposure"
    DEQUEUE = "dequeue time"  # the kernel's stamp could not be trusted


@dataclass(frozen=True, slots=True)
class Shutter:
    """Times of an image sensor [s]: period of the frames, exposure, and readout from
    first to last line.
    """

    period: float
    exposure: float
    readout: float

    def middle(
        self, stamp: float, flags: int, taken: float
    ) -> tuple[float, StampSource]:
        """Middle of a frame's exposure [s] on the monotonic clock, and the source of
        that time.

        It is from the kernel's `stamp`, or from the time `taken` at which the buffer
        was dequeued where the stamp is more than a period in the future, too old, or of
        another clock.
        """
        monotonic = flags & BufferFlag.TIMESTAMP_MASK == BufferFlag.TIMESTAMP_MONOTONIC
        if not (monotonic and -self.period < taken - stamp < OLDEST):
            return self._before_end(taken), StampSource.DEQUEUE
        if flags & BufferFlag.SOURCE_MASK == BufferFlag.SOURCE_START_OF_EXPOSURE:
            return stamp + self.exposure / 2, StampSource.START
        return self._before_end(stamp), StampSource.END

    def _before_end(self, end: float) -> float:
        return end - self.readout - self.exposure / 2


@dataclass(slots=True)
class Sequence:
    """Frame numbers that always increase, made from the kernel's 32-bit counter, which
    wraps and can repeat.

    `number` is the last frame's, -1 before the first.
    """

    number: int = -1
    _counter: int | None = None

    def step_to(self, counter: int) -> int:
        """Advance to the kernel's `counter`, and return how far it is from the last
        one, which is normally 1.

        It is more where frames are missing, and less where the counter repeats or goes
        back; such a frame is numbered as the next one.
        """
        step = 1
        if self._counter is not None:  # its difference, wrapped into -2^31 to 2^31 - 1
            step = (counter - self._counter + BITS // 2) % BITS - BITS // 2
        self._counter = counter
        self.number += max(step, 1)
        return step

    def restart(self, missing: int) -> None:
        """Continue after about `missing` lost frames with a kernel counter that starts
        anew.
        """
        self.number += missing
        self._counter = None


@dataclass(frozen=True, slots=True)
class CameraFrame(Frame):
    """Decoded frame of a V4L2 camera; `stamp_source` says from which time its stamp is
    computed.
    """

    stamp_source: StampSource


@dataclass(slots=True)
class Counts:
    """Counts of a camera's frames since it was connected.

    `arrived` complete, `missing` by sequence number, `corrupt` by the kernel's flag or
    the bytes, `repeated` numbers, `restamped` for a kernel stamp that cannot be right,
    `restarts` of the stream or the device.
    """

    arrived: int = 0
    missing: int = 0
    corrupt: int = 0
    repeated: int = 0
    restamped: int = 0
    restarts: int = 0


@dataclass(frozen=True, slots=True)
class Capture:
    """One captured frame: its bytes (n,) and metadata, copied from a buffer of the
    kernel.

    `counter` is the kernel's; `stamp` its time and `taken` the moment of dequeueing,
    both on the monotonic clock [s].
    """

    counter: int
    flags: int
    stamp: float
    taken: float
    content: Image

    @property
    def corrupt(self) -> bool:
        """Whether the kernel marks the frame as corrupt, or the frame is empty."""
        return bool(self.flags & BufferFlag.ERROR) or self.content.size == 0


@dataclass(frozen=True, slots=True)
class Setup:
    """Picture format, control values and shutter times of a camera, as read back."""

    picture: PictureFormat
    locks: Mapping[str, int]
    shutter: Shutter


class CaptureSession:
    """Open camera device with its `setup`, which streams into mapped buffers until
    `close`.
    """

    def __init__(self, device: Device, settings: V4l2Settings) -> None:
        """Configure the open camera `device`; raises CameraRefused for a value that it
        refuses.
        """
        self.setup = _set_up(device, settings)
        self._device = device
        self._buffers = settings.buffers
        self._mappings: list[MappedBuffer] = []

    @classmethod
    def open(cls, kernel: Kernel, settings: V4l2Settings) -> Self:
        """Open and configure the device that `settings` name, and start its stream.

        Raises CameraLost, CameraBusy, CameraFaulty or CameraRefused.
        """
        device = Device.open(kernel, settings.device)
        with ExitStack() as undo:  # an open device stays busy for others
            undo.callback(device.close)
            session = cls(device, settings)
            session._start()
            undo.pop_all()
        return session

    def wait(self, seconds: float) -> Capture | None:
        """Next frame of the stream, or None where none arrives within `seconds`.

        Raises CameraLost, or CameraFaulty where poll reports an event without a frame:
        polling again at once would be a busy loop.
        """
        device = self._device
        events = device.kernel.wait(device.fd, seconds)
        if not events:
            if not device.present():
                raise CameraLost(device.path, "no longer answers")
            return None

        capture = self._take()
        if capture is None:
            if not device.present():
                raise CameraLost(device.path, "is gone, says poll")
            raise CameraFaulty(device.path, "poll reports an error and no frame")
        return capture

    def restart(self) -> None:
        """Stop the stream and start it again; the device stays open with its setup."""
        self._stop()
        self._start()

    def close(self) -> None:
        """Stop the stream and release its buffers and the device."""
        self._stop()
        self._device.close()

    def _start(self) -> None:
        """Map and queue the buffers and start the stream; where that fails, nothing
        stays mapped.
        """
        device = self._device
        with ExitStack() as undo:  # a camera that streams refuses the next user
            undo.callback(self._stop)
            request = BufferRequest(count=self._buffers, type=CAPTURE, memory=MMAP)
            count = device.call(Ioctl.REQBUFS, request, "asking for buffers").count
            if count < FEWEST_BUFFERS:
                raise CameraFaulty(
                    device.path, f"gave {count} buffers of {self._buffers}"
                )

            for index in range(count):
                self._mappings.append(self._map_buffer(index))
                self._requeue(index)

            device.call(Ioctl.STREAMON, Number(CAPTURE), "starting the stream")
            undo.pop_all()

    def _take(self) -> Capture | None:
        """Copy of the next filled buffer, which is then requeued; None where no buffer
        is filled; raises CameraLost or CameraFaulty.
        """
        device = self._device
        buffer = Buffer(type=CAPTURE, memory=MMAP)
        with translated(device.path, "taking a frame"):
            try:
                device.kernel.ioctl(device.fd, Ioctl.DQBUF, buffer)
            except OSError as error:
                if error.errno == errno.EAGAIN:
                    return None
                if error.errno == errno.EINVAL:
                    stopped = "the kernel stopped the stream"
                    raise CameraFaulty(device.path, stopped) from None
                raise

        capture = Capture(  # a copy: the buffer's return to the queue overwrites it
            counter=buffer.sequence,
            flags=buffer.flags,
            stamp=buffer.timestamp.seconds + MICRO * buffer.timestamp.microseconds,
            taken=device.kernel.monotonic(),
            content=self._mappings[buffer.index].copy(buffer.bytesused),
        )
        self._requeue(buffer.index)
        return capture

    def _stop(self) -> None:
        """Stop the stream, unmap and free its buffers; errors of an unplugged device
        are ignored.

        Buffers are unmapped in any case: a remaining mapping keeps the node of an
        unplugged camera.
        """
        device = self._device
        with suppress(OSError):
            device.kernel.ioctl(device.fd, Ioctl.STREAMOFF, Number(CAPTURE))
        while self._mappings:
            self._mappings.pop().close()
        with suppress(OSError):
            none = BufferRequest(count=0, type=CAPTURE, memory=MMAP)
            device.kernel.ioctl(device.fd, Ioctl.REQBUFS, none)

    def _map_buffer(self, index: int) -> MappedBuffer:
        """Map the device's buffer `index` into memory; raises the camera's fault where
        refused.
        """
        device = self._device
        request = Buffer(index=index, type=CAPTURE, memory=MMAP)
        reply = device.call(Ioctl.QUERYBUF, request, "asking for a buffer")
        with translated(device.path, "sharing a buffer"):
            return device.kernel.map(device.fd, reply.length, reply.m.offset)

    def _requeue(self, index: int) -> None:
        buffer = Buffer(index=index, type=CAPTURE, memory=MMAP)
        self._device.call(Ioctl.QBUF, buffer, "giving a buffer back")


def _set_up(device: Device, settings: V4l2Settings) -> Setup:
    """Set format and controls of `device` as `settings` state; raises CameraRefused for
    a value that it refuses.
    """
    picture = negotiate(device, settings)
    locks = lock(device, settings.controls)
    exposure = settings.exposure
    control = controls_of(device).get(EXPOSURE)
    if control is not None and control.value is not None:
        exposure = control.value * EXPOSURE_UNIT
    shutter = Shutter(1.0 / picture.rate, exposure, settings.readout)
    return Setup(picture, locks, shutter)
