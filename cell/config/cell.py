"""The cell file: which drivers, where the arm stands, how fast, within which limits."""

from typing import Literal

from pydantic import Field

from calibration.board_views import BoardSettings
from calibration.perception.settings import PerceptionSettings
from calibration.touched_points import TouchSettings
from cell.config.fold import FoldSettings
from cell.orchestrator.monitors import MonitorLimits
from cell.record.frames import Keep
from drivers.installation import Installation
from drivers.settings import Settings
from drivers.twin.settings import TwinSettings


class DriverChoice(Settings):
    """Which implementation of each seam `cell` uses when the command line does not say."""

    arm: Literal["twin", "fci"] = "twin"
    camera: Literal["twin", "v4l2"] = "twin"


class RecordSettings(Settings):
    """Which images a run keeps; hashes of all are always kept."""

    frames: Keep = "key"


class SigmaSettings(Settings):
    """One-sigma noise of what this cell measures [m], [s]; measured on the twin, see runbooks."""

    contact_x: float = Field(gt=0, le=0.1)
    profile: float = Field(gt=0, le=0.1)
    gripper: float = Field(gt=0, le=0.1)
    displacement: float = Field(gt=0, le=0.1)
    touch_time: float = Field(gt=0, le=1.0)


class CellFile(Settings):
    """configs/cell.yaml."""

    schema_: Literal[1] = Field(1, alias="schema")
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
    drivers: DriverChoice = DriverChoice()
    calibration: str | None = None  # file, from this one; None: what `cell calibrate` keeps
    installation: Installation = Installation()
    fold: FoldSettings = FoldSettings()
    monitors: MonitorLimits = MonitorLimits()
    perception: PerceptionSettings = PerceptionSettings()
    boards: BoardSettings = BoardSettings()
    touches: TouchSettings = TouchSettings()
    record: RecordSettings = RecordSettings()
    sigma: SigmaSettings
    twin: TwinSettings
    effects: dict[str, dict[str, float]] = Field(default_factory=dict)
