"""Settings of the controller in cell.yaml: drivers, installation, speeds, limits,
learning.
"""

from functools import partial
from ipaddress import ip_address
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field

from calibration.board import BoardSettings
from calibration.view import LandmarkSettings
from calibration.wizard.latency import LatencySettings
from calibration.wizard.touches import TouchSettings
from cell.base.config.drivers import Driver, Kind, all_drivers, driver_names
from cell.record.files import Keep
from cell.record.film import Encoder
from drivers.base.installation import Installation
from drivers.base.plugins import plugin_names
from drivers.base.settings import Metres, Seconds, Settings, Speed, VersionedFile, parse
from drivers.franka.settings import FciSettings
from drivers.v4l2.settings import V4l2Settings
from policies.path import TAKEOVER_HEIGHT


def _check_driver(kind: Kind, name: str, *, plugin: bool = False) -> str:
    """Return `name` if a driver, or a `plugin`, of this `kind` has it; raises
    ValueError if not.
    """
    known = plugin_names(kind) if plugin else driver_names(kind)
    if name not in known:
        raise ValueError(
            f"must be one of {', '.join(known) or 'the plug-ins, none is installed'}"
        )
    return name


ArmName = Annotated[str, AfterValidator(partial(_check_driver, "arms"))]
CameraName = Annotated[str, AfterValidator(partial(_check_driver, "cameras"))]
PluginCamera = Annotated[
    str, AfterValidator(partial(_check_driver, "cameras", plugin=True))
]


class DriverChoice(Settings):
    """Drivers of arm and camera that `cell` uses unless the command line selects
    others.
    """

    arm: ArmName = "twin"
    camera: CameraName = "twin"


class RecordSettings(Settings):
    """Settings of a run's record: images to store, encoder of the film."""

    frames: Keep = "key"
    film: Encoder | Literal["none"] = "libx264"


class SigmaSettings(Settings):
    """Measurement noise of this cell, one sigma: lengths [m], `touch_time` [s], `force`
    [N].

    Measured on the twin, see runbooks. `force` is that of the arm's external wrench:
    without it recorded forces carry no weight.
    """

    contact_x: Metres = Field(gt=0, le=0.1)
    profile: Metres = Field(gt=0, le=0.1)
    gripper: Metres = Field(gt=0, le=0.1)
    displacement: Metres = Field(gt=0, le=0.1)
    touch_time: Seconds = Field(gt=0, le=1.0)
    # rms by folds; laid_fold.yaml has 0.44 mm
    edge_offset: Metres = Field(0.00055, gt=0, le=0.1)
    force: float | None = Field(
        None, gt=0, le=10.0, exclude_if=lambda force: force is None
    )


class FoldSettings(Settings):
    """Parameters of a fold; lengths [m], speeds [m/s], times [s]."""

    # Hz; records promise 100 rows a second
    control_rate: float = Field(100.0, ge=100, le=200)
    speed: Speed = Field(
        0.10, ge=0.005, le=0.16
    )  # on the path; faster, the lift out-turns the hand
    lay_speed: Speed = Field(0.10, ge=0.005, le=0.16)
    lay_height: Metres = Field(0.010, ge=0.005, le=0.06)  # of the edge above its place
    # by which the edge comes down farther out than a layer that bends up to the grip
    lay_beyond: Metres = Field(0.005, ge=0, le=0.02)
    # where the policy takes over
    takeover_height: Metres = Field(TAKEOVER_HEIGHT, ge=0.03, le=0.2)
    # of measured time; None: by the arm
    start: Literal["flat", "hanging"] | None = None
    # that a hanging strip is waited for
    longest_rest: Seconds = Field(4.0, ge=0.5, le=20.0)
    # free way before the edge is grasped
    approach: Metres = Field(0.05, ge=0.02, le=0.2)
    # of the gripper while the strip is judged
    clear_height: Metres = Field(0.25, ge=0.1, le=0.4)
    stop_timeout: Seconds = Field(1.0, ge=0.2, le=5.0)  # to come to rest after a fault


class MonitorLimits(Settings):
    """Limits of the safety monitors, each with a value; none can be switched off."""

    arm_age: float = Field(0.05, gt=0, le=0.5)  # s
    hand_age: float = Field(0.5, gt=0, le=2.0)  # s
    # s, from which on the arm stands and waits
    image_age: float = Field(0.25, gt=0, le=1.0)
    image_wait: float = Field(0.15, gt=0, le=1.0)  # s that it waits for a younger image
    reading: float = Field(0.25, gt=0, le=1.0)  # s beside the loop, of one image
    # one that a camera sends twice is none
    identical_images: int = Field(3, ge=2, le=30)
    confidence: float = Field(0.3, gt=0, lt=1)
    doubt: float = Field(0.4, gt=0, le=2.0)  # s of low confidence before the arm stops
    # m by which the scene may seem moved
    camera_shift: float = Field(0.001, gt=0, le=0.01)
    overspeed: float = Field(1.25, ge=1.0, le=2.0)  # measured over allowed speed
    speed: float = Field(0.25, gt=0, le=1.0)  # m/s
    tracking_error: float = Field(0.015, gt=0, le=0.1)  # m, measured from commanded
    # m that a measured pose may lie out of the box
    border: float = Field(0.005, gt=0, le=0.02)
    force: float = Field(20.0, gt=0, le=60.0)  # N on the gripper
    duration: float = Field(120.0, gt=0, le=900.0)  # s of a whole run
    state_duration: float = Field(60.0, gt=0, le=300.0)  # s in one state
    # s of a lock-step cycle; 1 s on the wall clock
    turn: float = Field(300.0, gt=0, le=3600)
    # s of CALIBRATE, which waits for people
    calibration: float = Field(1800.0, gt=0, le=14400.0)


class LearningSettings(Settings):
    """Settings of learning: whether the cell learns.

    `auto` learns with a real arm or camera and leaves folds of the twin repeatable by
    their seed.
    """

    use: Literal["auto", "on", "off"] = "auto"


class CellSettings(VersionedFile):
    """Settings of the controller: everything in cell.yaml but the twin."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
    drivers: DriverChoice = DriverChoice()
    # file, relative to this one; None: the one of `cell calibrate`
    calibration: str | None = None
    camera: V4l2Settings | None = None  # the real one; None: this cell has none
    cameras: dict[PluginCamera, dict[str, Any]] = Field(  # their own settings, by name
        default_factory=dict, exclude_if=lambda cameras: not cameras
    )
    installation: Installation = Installation()
    fci: FciSettings = FciSettings()
    fold: FoldSettings = FoldSettings()
    monitors: MonitorLimits = MonitorLimits()
    boards: BoardSettings = BoardSettings()
    touches: TouchSettings = TouchSettings()
    latency: LatencySettings = LatencySettings()
    landmarks: LandmarkSettings = LandmarkSettings()
    learning: LearningSettings = LearningSettings()
    # after which hardware calibrates anew
    calibration_days: float = Field(30.0, gt=0, le=3650)
    record: RecordSettings = RecordSettings()
    sigma: SigmaSettings
    effects: dict[str, dict[str, float]] = Field(default_factory=dict)

    def with_drivers(self, arm: str | None = None, camera: str | None = None) -> Self:
        """Copy with the drivers of these names; ConfigurationError for an unknown
        one.
        """
        drivers = self.drivers
        named = {"arm": arm or drivers.arm, "camera": camera or drivers.camera}
        return self.model_copy(
            update={"drivers": parse(named, DriverChoice, "drivers")}
        )

    @property
    def arm_driver(self) -> Driver:
        """Driver of the arm."""
        return all_drivers("arms")[self.drivers.arm]

    @property
    def camera_driver(self) -> Driver:
        """Driver of the camera."""
        return all_drivers("cameras")[self.drivers.camera]

    @property
    def robot_address(self) -> str | None:
        """Address of the Franka robot, real or emulated; None for any other arm."""
        return self.fci.address if self.arm_driver.is_franka else None

    @property
    def has_real_arm(self) -> bool:
        """Whether the arm is a physical robot, not simulated or emulated on this
        machine, or is to be treated as one.
        """
        arm = self.arm_driver
        address = self.robot_address
        if address is None:
            return arm.real and not arm.is_franka
        try:
            return self.fci.ask or not ip_address(address).is_loopback
        except ValueError:
            return address != "localhost"

    @property
    def is_physical(self) -> bool:
        """Whether the cell has a physical robot or a real camera."""
        return self.has_real_arm or self.camera_driver.real

    @property
    def emulation(self) -> str:
        """Text for the operator where the robot is emulated; empty for any other
        arm.
        """
        if not self.arm_driver.real or self.has_real_arm:
            return ""
        if self.fci.address is None:
            return "emulated robot: fci.address in cell.yaml is empty"
        return f"emulated robot at {self.fci.address}, on this machine"
