"""A V4L2 camera that is open, configured from the cell file, and streams into mapped
buffers.
"""

import errno
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import Self

from drivers.base.types import Image
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
    translate_error,
)
from drivers.v4l2.formats import Picture, negotiate
from drivers.v4l2.frame import Shutter
from drivers.v4l2.settings import V4l2Settings

FEWEST_BUFFERS = 2
MICRO = 1e-6


@dataclass(frozen=True, slots=True)
class Capture:
    """One captured frame: bytes (n,) and metadata of a buffer, copied before its
    requeueing.

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
        """Whether the kernel marks the frame as corrupt, or it is empty."""
        return bool(self.flags & BufferFlag.ERROR) or self.content.size == 0


@dataclass(frozen=True, slots=True)
class Setup:
    """Picture format, control values and shutter times of a camera, as read back."""

    picture: Picture
    locks: Mapping[str, int]
    shutter: Shutter


class Session:
    """An open camera device with its `setup`, streaming into mapped buffers until
    `close`.
    """

    def __init__(self, device: Device, settings: V4l2Settings) -> None:
        """Configure the open camera `device`; raises CameraRefused for a value that it
        refuses.
        """
        self.setup = set_up(device, settings)
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
        """Map and queue buffers, start the stream; on failure nothing stays mapped."""
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
        """Copy and requeue the next filled buffer, or None; raises CameraLost,
        CameraFaulty.
        """
        device = self._device
        buffer = Buffer(type=CAPTURE, memory=MMAP)
        try:
            device.kernel.ioctl(device.fd, Ioctl.DQBUF, buffer)
        except OSError as error:
            if error.errno == errno.EAGAIN:
                return None
            if error.errno == errno.EINVAL:  # the queue has stopped by itself
                raise CameraFaulty(
                    device.path, "the kernel stopped the stream"
                ) from None
            raise translate_error(error, device.path, "taking a frame", "") from None
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
        """Stop streaming, unmap and free the buffers; errors of an unplugged device are
        ignored.

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
        try:
            return device.kernel.map(device.fd, reply.length, reply.m.offset)
        except OSError as error:
            raise translate_error(error, device.path, "sharing a buffer", "") from None

    def _requeue(self, index: int) -> None:
        buffer = Buffer(index=index, type=CAPTURE, memory=MMAP)
        self._device.call(Ioctl.QBUF, buffer, "giving a buffer back")


def set_up(device: Device, settings: V4l2Settings) -> Setup:
    """Set format and controls of `device`; raises CameraRefused for a value that it
    refuses.
    """
    picture = negotiate(device, settings)
    locks = lock(device, settings.controls)
    exposure = settings.exposure
    control = controls_of(device).get(EXPOSURE)
    if control is not None and control.value is not None:
        exposure = control.value * EXPOSURE_UNIT
    shutter = Shutter(1.0 / picture.rate, exposure, settings.readout)
    return Setup(picture, locks, shutter)
