"""Settings of the twin's camera: its place, lens and sensor, and what surrounds the strip."""

import hashlib
from math import radians
from typing import Annotated, Self

from pydantic import Field, model_validator

from drivers.settings import Settings

STEEPEST = radians(5.0)  # from higher up the lower layer's face hides the closing gap

Channel = Annotated[int, Field(ge=0, le=255)]
Colour = tuple[Channel, Channel, Channel]
Offset = Annotated[float, Field(ge=-0.05, le=0.05)]


class Surroundings(Settings):
    """Colours in sRGB, and extent [m] in y of the desk; the strip's near edge lies at y = 0.

    A bright green mat before a green backdrop, as for chroma keying: white, black, grey, brown,
    red, blue and teal fabrics all differ from it, in colour where they do not in brightness.
    """

    desk: Colour = (106, 196, 72)
    backdrop: Colour = (84, 172, 62)
    panel: Colour = (96, 92, 86)
    gripper: Colour = (44, 45, 48)
    clamp: Colour = (150, 152, 156)
    desk_front: float = Field(-0.22, ge=-1.0, le=-0.02)
    desk_back: float = Field(0.45, ge=0.05, le=3.0)


class CameraSettings(Settings):
    """A camera that looks along +y at the plane y = 0, from `distance` [m] before it.

    Angles [rad]: `elevation` above the desk seen from the near edge, at most 5 degrees; `yaw`,
    `tilt` and `roll` are what its mounting is off by. The optical axis aims at (`aim_x`, `aim_z`)
    and the image is `view_width` [m] wide there. `principal` is the principal point's offset from
    the centre and `lens_blur` the sigma of the lens [px]; `distortion` the radial k1, k2.
    Times [s]: `exposure`, and `transport_delay` from its middle until the frame is known.
    `noise` is the sensor's sigma in grey levels, without which a still picture looks frozen to
    the cell; the rest are shares of brightness.
    """

    width: int = Field(1280, ge=320, le=4096)
    height: int = Field(720, ge=240, le=2160)
    rate: float = Field(60.0, gt=0, le=240)
    exposure: float = Field(0.004, gt=0, le=0.02)
    transport_delay: float = Field(0.02, ge=0, le=0.5)
    sub_shapes: int = Field(3, ge=1, le=9)
    distance: float = Field(2.0, ge=0.5, le=5.0)
    elevation: float = Field(radians(3.0), gt=0, le=STEEPEST)
    aim_x: float = Field(0.31, ge=-0.5, le=2.0)
    aim_z: float = Field(0.158, ge=-0.2, le=1.0)
    view_width: float = Field(0.75, ge=0.2, le=3.0)
    yaw: Offset = 0.002
    tilt: Offset = -0.001
    roll: Offset = 0.004
    principal: tuple[float, float] = (5.0, -4.0)
    distortion: tuple[float, float] = (-0.18, 0.10)
    lens_blur: float = Field(0.7, ge=0, le=4)
    noise: float = Field(2.0, ge=0, le=30)
    gain: float = Field(1.0, gt=0.1, le=3)
    light_gradient: float = Field(0.12, ge=0, le=0.6)
    vignetting: float = Field(0.10, ge=0, le=0.6)
    texture: float = Field(0.05, ge=0, le=0.4)
    shadow: float = Field(0.30, ge=0, le=0.9)
    surroundings: Surroundings = Surroundings()

    @model_validator(mode="after")
    def _arrives_after_exposure(self) -> Self:
        if self.transport_delay < self.exposure / 2:
            raise ValueError(
                f"transport_delay {self.transport_delay} s ends before the exposure does; "
                f"allowed: at least half of the exposure, {self.exposure / 2} s"
            )
        if self.exposure * self.rate > 1:
            raise ValueError(
                f"exposure {self.exposure} s is longer than a frame of {1 / self.rate:.4f} s"
            )
        return self

    @property
    def focal(self) -> float:
        """Focal length [px]."""
        return self.distance * self.width / self.view_width

    @property
    def identity(self) -> str:
        """Hash of everything above: what a calibration of this camera belongs to."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]
