"""What stands at the head and at the end of a run: run.yaml and result.yaml."""

from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from drivers.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class Recorded(Settings):
    """Base of what a program writes: unknown keys are kept, missing and broken ones refused."""

    model_config = ConfigDict(extra="allow")

    schema_: Literal[1] = Field(1, alias="schema")


class Sigma(Settings):
    """One-sigma noise of what a run measures: [m], `touch_time` [s], `force` [N]."""

    model_config = ConfigDict(extra="allow")

    contact_x: Positive
    profile: Positive
    gripper: Positive
    displacement: Positive
    touch_time: Positive | None = None
    force: Positive | None = None


class DriverNames(Settings):
    """Which drivers a run was made with."""

    model_config = ConfigDict(extra="allow")

    arm: str = ""
    camera: str = ""


class CalibrationNote(Settings):
    """Which calibration a run was made with, and its error [m]."""

    model_config = ConfigDict(extra="allow")

    id: str = ""
    error: float | None = None


class ArmTiming(Recorded):
    """How often a real arm's states came after so many milliseconds: bins between `edges_ms`.

    `counts` has one more entry than the edges, open below the first and above the last.
    """

    edges_ms: list[float]
    counts: list[int]
    longest_ms: float
    answered: float | None = None


class Header(Recorded):
    """run.yaml: what every reader of a measured run needs, and how a run of the cell was made.

    The fields from `policy` on are absent where a laboratory wrote the file. `strip_file` and
    `config` are the files as they were resolved, read again by whoever needs them.
    """

    strip: str = Field(min_length=1)
    sigma: Sigma
    start: Literal["flat", "hanging"] = "flat"
    index: int | None = None
    condition: str | None = None
    speed: Positive | None = None
    camera_hz: Positive | None = None
    contact_height: Positive = 0.001
    policy: str | None = None
    checkpoint: dict[str, Any] | None = None
    seed: int | None = None
    drivers: DriverNames | None = None
    calibration: CalibrationNote | None = None
    versions: dict[str, str] | None = None
    strip_file: dict[str, Any] | None = None
    config: dict[str, Any] | None = None
    plant_sha256: str | None = None
    preflight: list[dict[str, Any]] | None = None
    arm_timing: ArmTiming | None = None


class Result(Recorded):
    """result.yaml: the outcome, and with layer_touch its time [s] and lengths [m].

    A run of the cell adds why it ended, its `duration` [s], the `confidence` in the touch, and
    `edge_offset` [m] of the grasped edge once laid.
    """

    outcome: str = Field(min_length=1)
    t_layer_touch: float | None = None
    displacement: float | None = None
    l1: float | None = None
    l2: float | None = None
    reason: str | None = None
    duration: float | None = None
    confidence: float | None = None
    edge_offset: float | None = None

    @model_validator(mode="after")
    def _touch_is_whole(self) -> Self:
        needed = ("t_layer_touch", "displacement", "l1", "l2")
        missing = [key for key in needed if getattr(self, key) is None]
        if self.outcome == "layer_touch" and missing:
            raise ValueError(f"outcome layer_touch needs {', '.join(missing)} too")
        return self
