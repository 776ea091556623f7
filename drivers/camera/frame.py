"""Frames of the V4L2 camera, and counts of them."""

from dataclasses import dataclass

from drivers.camera.stamps import StampSource
from drivers.types import Frame


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
