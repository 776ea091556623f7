"""Settings of the simulated cell: arm, hand, camera and world."""

import hashlib
from math import radians
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from drivers.base.settings import Settings
from drivers.franka.model import ArmPlant
from drivers.strip.file import Colour
from drivers.twin.renderer.looks import DEFAULT_LOOK, check_look

# from higher up the lower layer's face hides the closing gap
HIGHEST_ELEVATION = radians(5.0)

Offset = Annotated[float, Field(ge=-0.05, le=0.05)]


class Surroundings(Settings):
    """Colours (sRGB) of the cell around the strip, and extent [m] in y of the desk.

    The strip's near edge lies at y = 0. A bright green mat before a green backdrop, as
    for chroma keying: white, black, grey, brown, red, blue and teal fabrics all differ
    from it, in colour where they do not in brightness.
    """

    desk: Colour = (106, 196, 72)
    backdrop: Colour = (84, 172, 62)
    panel: Colour = (96, 92, 86)
    gripper: Colour = (44, 45, 48)
    clamp: Colour = (150, 152, 156)
    desk_front: float = Field(-0.22, ge=-1.0, le=-0.02)
    desk_back: float = Field(0.45, ge=0.05, le=3.0)


class CameraSettings(Settings):
    """Settings of the simulated camera, which looks along +y at the plane y = 0.

    It stands `distance` [m] before the plane. Angles [rad]: `elevation` above the desk
    seen from the near edge, at most 5 degrees; `yaw`, `tilt` and `roll` are mounting
    errors. The optical axis aims at (`aim_x`, `aim_z`) and the image is `view_width`
    [m] wide there. `principal` is the principal point's offset from the centre and
    `lens_blur` the sigma of the lens [px]; `distortion` the radial k1, k2. Times [s]:
    `exposure`, and `transport_delay` from its middle until the frame arrives. The share
    `lost` of the frames never arrives. `noise` is the sensor's sigma in grey levels;
    the rest are fractions of brightness.
    """

    width: int = Field(1280, ge=320, le=4096)
    height: int = Field(720, ge=240, le=2160)
    rate: float = Field(60.0, gt=0, le=240)
    exposure: float = Field(0.004, gt=0, le=0.02)
    transport_delay: float = Field(0.02, ge=0, le=0.5)
    lost: float = Field(0.0, ge=0, le=0.9, exclude_if=lambda share: share == 0)
    sub_shapes: int = Field(3, ge=1, le=9)
    distance: float = Field(2.0, ge=0.5, le=5.0)
    elevation: float = Field(radians(3.0), gt=0, le=HIGHEST_ELEVATION)
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
    def _exposure_fits_into_frame(self) -> Self:
        """Refuse an exposure that is longer than a frame."""
        if self.exposure * self.rate > 1:
            raise ValueError(
                f"exposure {self.exposure} s is longer than a frame of"
                f" {1 / self.rate:.4f} s"
            )
        return self

    @property
    def focal(self) -> float:
        """Focal length [px] of the camera."""
        return self.distance * self.width / self.view_width

    @property
    def identity(self) -> str:
        """Hash of all settings of the camera, which a calibration must match."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]


class WrenchSettings(Settings):
    """Noise and bias [N, one sigma] and lag [s] of the force that the twin's arm
    reports.

    Each reading has the `noise`, each session a `bias`, the error of its tare; readings
    are averaged over `lag`. Source: assumed. A user's Franka at rest reports forces
    that scatter by 10 mN and are 1 to 2 N off, depending on its posture
    (franka_ros#404): it needs a tare near where the strip is folded, and real sensors
    have errors beyond this model.
    """

    noise: float = Field(0.01, gt=0, le=5.0)
    bias: float = Field(0.1, ge=0, le=5.0)
    lag: float = Field(0.01, ge=0, le=1.0)


class ArmSettings(Settings):
    """Settings of the twin's arm: lengths [m], angles [rad], times [s].

    It lags its commands by `lag` and measures its pose with `noise` and `pitch_noise`
    (one sigma). The emulated robot of arm fci lags by `robot_delay` and `robot_lag`
    instead; with a `robot_plant` it reports torques of a moving arm with those
    mechanics. It reports no force without `force`.
    """

    lag: float = Field(0.004, ge=0, le=0.1)
    robot_delay: float = Field(0.0, ge=0, le=0.1, exclude_if=lambda time: time == 0)
    robot_lag: float = Field(0.0, ge=0, le=0.1, exclude_if=lambda time: time == 0)
    robot_plant: ArmPlant | None = Field(None, exclude_if=lambda plant: plant is None)
    noise: float = Field(2e-5, ge=0, le=0.005)
    pitch_noise: float = Field(1e-4, ge=0, le=0.05)
    force: WrenchSettings | None = Field(None, exclude_if=lambda force: force is None)


class HandSettings(Settings):
    """Settings of the twin's hand: lengths [m], angles [rad]."""

    opening: float = Field(0.04, ge=0.01, le=0.08)  # between open fingers
    speed: float = Field(0.08, gt=0, le=0.5)  # m/s, of the width
    reach: float = Field(0.005, gt=0, le=0.02)  # from gripper to edge for a grasp
    lean: float = Field(0.3, gt=0, le=1.0)  # between gripper and edge for a grasp


class WorldSettings(Settings):
    """Settings of the twin's desk and simulated strip: times [s]."""

    links: int = Field(60, ge=40, le=400)
    step: float = Field(0.005, ge=0.0005, le=0.005)
    memory: float = Field(1.0, ge=0.1, le=10.0)  # how far back the camera can look
    strip: bool = True  # whether one lies on the desk


class TwinSettings(Settings):
    """Settings of all simulated devices.

    `look` names the surroundings of the strip, their light and the print on the strip.
    """

    # The plain look is left out of files: nothing that is kept of a cell changes by its
    # name.
    look: Annotated[str, AfterValidator(check_look)] = Field(
        DEFAULT_LOOK, exclude_if=lambda name: name == DEFAULT_LOOK
    )
    arm: ArmSettings = ArmSettings()
    hand: HandSettings = HandSettings()
    world: WorldSettings = WorldSettings()
    camera: CameraSettings = CameraSettings()

    @model_validator(mode="after")
    def _exposure_is_simulated_when_it_arrives(self) -> Self:
        """Refuse frames that arrive before the world of their exposure is simulated."""
        if self.camera.transport_delay < self.earliest_image:
            raise ValueError(
                f"camera.transport_delay {self.camera.transport_delay} s is over before"
                " the strip has been simulated; allowed: at least exposure / 2 +"
                f" world.step, {self.earliest_image} s"
            )
        return self

    @property
    def earliest_image(self) -> float:
        """Shortest time [s] from the middle of an exposure until the strip of its end
        is simulated.
        """
        return self.camera.exposure / 2 + self.world.step
