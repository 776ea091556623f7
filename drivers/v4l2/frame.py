"""Metadata of V4L2 frames: time of exposure, sequence number, and counts of lost
frames.
"""

from dataclasses import dataclass
from enum import StrEnum

from drivers.base.types import Frame
from drivers.v4l2.abi import BufferFlag

OLDEST = 2.0  # s; a stamp further back is not of this frame
BITS = 1 << 32


class StampSource(StrEnum):
    """Time from which a frame's stamp is computed: the kernel's of the exposure, or of
    dequeue.
    """

    START = "start of exposure"
    END = "end of exposure"
    DEQUEUE = "dequeue time"  # the kernel's stamp could not be trusted


@dataclass(frozen=True, slots=True)
class Shutter:
    """Times of an image sensor [s]: frame period, exposure, readout from first to last
    line.
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
    """Increasing frame numbers from the kernel's 32-bit counter, which wraps and can
    repeat.

    `number` is the last frame's, -1 before the first.
    """

    number: int = -1
    _counter: int | None = None

    def step_to(self, counter: int) -> int:
        """Advance to the kernel's `counter`, and return the difference from the last: 1
        normally.

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
