"""Settings that the controller may use: drivers, installation, speeds, limits."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from calibration.board import BoardSettings
from calibration.landmarks import LandmarkSettings
from calibration.wizard.latency import LatencySettings
from calibration.wizard.touches import TouchSettings
from cell.config.drivers import arm_names, camera_names
from cell.config.fold import FoldSettings
from cell.config.learning import LearningSettings
from cell.config.monitor_limits import MonitorLimits
from cell.perception.settings import PerceptionSettings
from cell.record.film import Encoder
from cell.record.frames import Keep
from drivers.arm.settings import FciSettings
from drivers.camera.settings import V4l2Settings
from drivers.installation import Installation
from drivers.settings import Metres, Seconds, Settings


def _check_driver(name: str, known: tuple[str, ...]) -> str:
    if name not in known:
        raise ValueError(f"must be one of {', '.join(known)}")
    return name


ArmName = Annotated[str, AfterValidator(lambda name: _check_driver(name, arm_names()))]
CameraName = Annotated[str, AfterValidator(lambda name: _check_driver(name, camera_names()))]


class DriverChoice(Settings):
    """Driver of each device that `cell` uses unless the command line selects another."""

    arm: ArmName = "twin"
    camera: CameraName = "twin"


class RecordSettings(Settings):
    """Settings of a record: images to keep, encoder of the film; hashes of all images are kept."""

    frames: Keep = "key"
    film: Encoder | Literal["none"] = "libx264"


class SigmaSettings(Settings):
    """One-sigma measurement noise of this cell: lengths [m], `touch_time` [s], `force` [N].

    Measured on the twin, see runbooks. `force` is that of the arm's external wrench: without it
    recorded forces carry no weight.
    """

    contact_x: Metres = Field(gt=0, le=0.1)
    profile: Metres = Field(gt=0, le=0.1)
    gripper: Metres = Field(gt=0, le=0.1)
    displacement: Metres = Field(gt=0, le=0.1)
    touch_time: Seconds = Field(gt=0, le=1.0)
    edge_offset: Metres = Field(0.00055, gt=0, le=0.1)  # rms by folds; laid.yaml has 0.44 mm
    force: float | None = Field(None, gt=0, le=10.0, exclude_if=lambda force: force is None)


class CellSettings(Settings):
    """A cell as its controller knows it: everything in cell.yaml but the twin."""

    schema_: Literal[1] = Field(1, alias="schema")
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
    drivers: DriverChoice = DriverChoice()
    calibration: str | None = None  # file, from this one; None: what `cell calibrate` keeps
    camera: V4l2Settings | None = None  # the real one; None: this cell has none
    installation: Installation = Installation()
    fci: FciSettings = FciSettings()
    fold: FoldSettings = FoldSettings()
    monitors: MonitorLimits = MonitorLimits()
    perception: PerceptionSettings = PerceptionSettings()
    boards: BoardSettings = BoardSettings()
    touches: TouchSettings = TouchSettings()
    latency: LatencySettings = LatencySettings()
    landmarks: LandmarkSettings = LandmarkSettings()
    learning: LearningSettings = LearningSettings()
    calibration_days: float = Field(30.0, gt=0, le=3650)  # after which hardware calibrates anew
    record: RecordSettings = RecordSettings()
    sigma: SigmaSettings
    effects: dict[str, dict[str, float]] = Field(default_factory=dict)
