"""Settings of the V4L2 camera in the cell file."""

import hashlib
from typing import Literal

from pydantic import Field

from drivers.base.settings import Settings

PixelFormat = Literal["YUYV", "GREY", "MJPG", "RGGB", "GRBG", "BA81", "GBRG"]


class V4l2Settings(Settings):
    """Device, mode and fixed control values of the V4L2 camera.

    `device` is a udev link to this camera or port; device numbers change between boots.
    Automatic controls are switched off first, then `controls` are set; the values
    belong to the calibration, because focus and zoom move the lens. Times [s]:
    `exposure` where the camera has no exposure_time_absolute, `readout` from the first
    to the last line, `stall` without a frame until the camera counts as stalled.
    """

    device: str = Field(pattern=r"^/dev/v4l/by-(id|path)/[^/]+$")
    format: PixelFormat = "YUYV"
    width: int = Field(1280, ge=16, le=8192)
    height: int = Field(720, ge=16, le=8192)
    rate: float = Field(30.0, ge=1, le=1000)
    controls: dict[str, int] = Field(default_factory=dict)
    exposure: float = Field(0.0, ge=0, le=1)
    readout: float = Field(0.0, ge=0, le=1)
    stall: float = Field(0.5, ge=0.1, le=10)
    buffers: int = Field(4, ge=2, le=32)

    @property
    def identity(self) -> str:
        """Hash of the camera's device, image size and controls, which a calibration
        must match.
        """
        facts = self.model_dump_json(include={"device", "width", "height", "controls"})
        return hashlib.sha256(facts.encode()).hexdigest()[:16]
