"""Settings that the controller may use: drivers, installation, speeds, limits."""

from typing import Literal

from pydantic import Field

from calibration.board_settings import BoardSettings
from calibration.landmarks import LandmarkSettings
from calibration.perception.settings import PerceptionSettings
from calibration.touch_settings import TouchSettings
from calibration.wizard.latency import LatencySettings
from cell.config.fold import FoldSettings
from cell.config.monitor_limits import MonitorLimits
from cell.record.frames import Keep
from drivers.arm.settings import FciSettings
from drivers.camera.settings import V4l2Settings
from drivers.installation import Installation
from drivers.settings import Settings


class DriverChoice(Settings):
    """Driver of each device that `cell` uses unless the command line selects another."""

    arm: Literal["twin", "fci"] = "twin"
    camera: Literal["twin", "v4l2"] = "twin"


class RecordSettings(Settings):
    """Which images a run keeps; hashes of all are always kept."""

    frames: Keep = "key"


class SigmaSettings(Settings):
    """One-sigma measurement noise of this cell [m], [s]; measured on the twin, see runbooks."""

    contact_x: float = Field(gt=0, le=0.1)
    profile: float = Field(gt=0, le=0.1)
    gripper: float = Field(gt=0, le=0.1)
    displacement: float = Field(gt=0, le=0.1)
    touch_time: float = Field(gt=0, le=1.0)


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
    calibration_days: float = Field(30.0, gt=0, le=3650)  # after which hardware calibrates anew
    record: RecordSettings = RecordSettings()
    sigma: SigmaSettings
    effects: dict[str, dict[str, float]] = Field(default_factory=dict)
