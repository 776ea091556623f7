"""Frames of the V4L2 camera: time of exposure, number, and counts of what happened to them."""

from dataclasses import dataclass
from enum import StrEnum

from drivers.camera.abi import BufferFlag
from drivers.types import Frame

OLDEST = 2.0  # s; a stamp further back is not of this frame
BITS = 1 << 32


class StampSource(StrEnum):
    """Origin of a frame's stamp: the kernel's time of the exposure, or the dequeue time."""

    START = "start of exposure"
    END = "end of exposure"
    DEQUEUE = "dequeue time"  # the kernel's stamp could not be trusted


@dataclass(frozen=True, slots=True)
class Shutter:
    """Times of a sensor [s]: frame period, exposure, readout from first to last line."""

    period: float
    exposure: float
    readout: float

    def middle(self, stamp: float, flags: int, taken: float) -> tuple[float, StampSource]:
        """Middle of the exposure [s] on the kernel's monotonic clock, and the source of that stamp.

        `taken` is when the buffer was dequeued. Stamps more than a period in the future, too old,
        or of another clock are replaced by it.
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
    """Increasing frame numbers from the kernel's 32-bit counter, which wraps and can repeat.

    `number` is that of the last frame, -1 before the first.
    """

    number: int = -1
    _counter: int | None = None

    def step_to(self, counter: int) -> int:
        """Advance to the kernel's `counter`; returns the steps: 1, more where frames are missing.

        Less for a counter that repeats or goes back; such a frame is the next one.
        """
        step = 1 if self._counter is None else signed_difference(counter - self._counter)
        self._counter = counter
        self.number += max(step, 1)
        return step

    def restart(self, missing: int) -> None:
        """Restart the count after about `missing` lost frames, with a new kernel counter."""
        self.number += missing
        self._counter = None


def signed_difference(difference: int) -> int:
    """A `difference` of two 32-bit counters, wrapped into -2^31 to 2^31 - 1."""
    return (difference + BITS // 2) % BITS - BITS // 2


@dataclass(frozen=True, slots=True)
class CameraFrame(Frame):
    """A frame with the number `gap` of frames lost before it and the source of its stamp.

    `flags` are the kernel's. Frames that the kernel marks as corrupt are dropped.
    """

    gap: int
    stamp_source: StampSource
    flags: int


@dataclass(slots=True)
class Counts:
    """Numbers of frames since the camera was connected, by what happened to them.

    `arrived` whole, `missing` by sequence, `corrupt` by the kernel's flag or their own bytes,
    `repeated` numbers, `restamped` because the kernel's stamp could not be trusted, `restarts`
    of the stream or the device.
    """

    arrived: int = 0
    missing: int = 0
    corrupt: int = 0
    repeated: int = 0
    restamped: int = 0
    restarts: int = 0
