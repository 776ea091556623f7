"""A frame of the real camera."""

from dataclasses import dataclass

from drivers.camera.stamps import StampSource
from drivers.types import Frame


@dataclass(frozen=True, slots=True)
class CameraFrame(Frame):
    """A frame with `gap` frames missing since the last that arrived, and what its stamp rests on.

    `flags` are the kernel's. A frame that the kernel marks as corrupt never becomes one of these.
    """

    gap: int
    stamp_source: StampSource
    flags: int


@dataclass(slots=True)
class Counts:
    """What happened to the frames since the camera was connected.

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
