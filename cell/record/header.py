"""Schemas of a run's header run.yaml and of its result.yaml, and the names of
outcomes.
"""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from cell.record.files import RESULT
from drivers.base.settings import Metres, Settings, Unit, load

Positive = Annotated[float, Field(gt=0)]
Accuracy = Annotated[
    Metres,
    Field(gt=0, description="its accuracy, one sigma in m: 0.0001 where it is 0.1 mm"),
]
Number = Annotated[float, Field(ge=-1e9, le=1e9)]  # in any unit, mistaken ones included
UNMEASURED = 1.0  # m, an error beside which nothing of a cell matters
LAID = frozenset(
    {"unlike_model", "grip_apart", "displacement_apart", "free_edge_apart"}
)
"""The strip lies folded, and yet not as the cell was told or saw it."""
NOT_FOLDED = LAID | {"edges_not_seen", "edges_apart"}
"""The layers touched, which was measured, and yet nobody may call the fold a success.
"""
OUTCOMES = NOT_FOLDED.union(
    ("layer_touch", "path_done", "calibrated"),  # goals
    # stops
    ("interrupted", "preflight_refused", "error", "internal_error", "record", "exam"),
    (
        "command_refused",
        "motion_refused",
        "velocity_refused",
        "outside_workspace",
        "turn_overtime",
    ),
    # the cell's
    ("illegal_event", "no_perception", "process_died", "world_unknown", "unexpected"),
    ("no_aids", "no_latency"),
)
DEVICES = (
    "arm_",
    "hand_",
    "grasp_",
    "camera_",
    "image_",
    "simulation_",
    "strip_",
    "robot_",
)
"""Each device names its own faults after itself; other faults are named by a monitor.
"""


class RecordPart(Settings):
    """Base class of an entry of run.yaml or result.yaml, which may hold further
    keys.
    """

    model_config = ConfigDict(extra="allow")


class Recorded(RecordPart):
    """Base class of a file that programs write, with the number of its schema."""

    schema_: Literal[1] = Field(1, alias="schema")


class Sigma(RecordPart):
    """Measurement noise of a run, one sigma: lengths [m], `touch_time` [s], `force`
    [N].

    `edge_offset` [m] is the error of the camera's view of the laid edges.
    What is not stated was not measured: rows of it, if there are any, carry no weight.
    """

    contact_x: Accuracy = UNMEASURED
    profile: Accuracy = UNMEASURED
    gripper: Accuracy
    displacement: Accuracy = UNMEASURED
    touch_time: Positive | None = None
    edge_offset: Positive | None = None
    force: Positive | None = None


class DriverNames(RecordPart):
    """Names of the drivers of arm and camera in a run."""

    arm: str = ""
    camera: str = ""


class CalibrationNote(RecordPart):
    """Id of the calibration that a run used, and its `error` [m]."""

    id: str = ""
    error: float | None = None


class ArmTiming(RecordPart):
    """Longest time [ms] between two states that a real arm sent; their histogram is not
    read.
    """

    longest_ms: float


class Header(Recorded):
    """Contents of run.yaml of a fold: what every reader needs, and how the cell made
    the run.

    The fields from `policy` on are absent in a laboratory's file. `strip_file` and
    `config` are the resolved contents of those files.
    """

    strip: str = Field(min_length=1)
    sigma: Sigma
    start: Literal["flat", "hanging"] = "flat"
    index: int | None = Field(None, ge=0, le=1_000_000)
    condition: str | None = None
    speed: float | None = Field(None, gt=0, le=10.0)  # m/s, beyond any arm
    camera_hz: float | None = Field(None, gt=0, le=100_000.0)  # beyond any camera
    # m, a fold stands hardly higher
    contact_height: float = Field(0.001, gt=0, le=0.05)
    policy: str | None = None
    checkpoint: dict[str, Any] | None = None
    seed: int | None = None
    drivers: DriverNames | None = None
    calibration: CalibrationNote | None = None
    versions: dict[str, str] | None = None
    strip_file: dict[str, Any] | None = None
    config: dict[str, Any] | None = None
    plant_sha256: str | None = None
    learning: dict[str, Any] | None = None
    line: float | None = Field(None, gt=0, le=10.0)  # m, from the grasped edge
    preflight: list[dict[str, Any]] | None = None
    arm_timing: ArmTiming | None = None
    seen_by: Literal["cell"] | None = None  # in runs without a policy

    @property
    def by_cell(self) -> bool:
        """Whether the strip was measured by the perception of this cell, whose errors
        are known.
        """
        return self.policy is not None or self.seen_by == "cell"


class Load(RecordPart):
    """Load of a mechanism in a run: `body` that carries it, `mass` [kg], `com` (3,)
    [m].
    """

    body: str
    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)


class AngleNoise(RecordPart):
    """Measurement noise of a pendulum's readings, one sigma of the `angle` [rad]."""

    angle: Annotated[float, Unit("rad"), Field(gt=0.0, lt=0.3)] | None = None


class MechanismRun(Recorded):
    """Contents of run.yaml of a mechanism, or of a pendulum, which states its own noise
    `sigma`.

    `index` is that in its series, `origin` the recording that contains the run.
    """

    mechanism: str | None = None
    pendulum: str | None = None
    sigma: AngleNoise = AngleNoise()
    index: int | None = Field(None, ge=0, le=1_000_000)
    condition: str | float | None = None
    origin: str | float | None = None
    load: Load | None = None


class EstimatedValue(RecordPart):
    """Value that a policy estimated for a strip's parameter, with its 68 % interval, in
    SI.
    """

    value: Number
    low: Number
    high: Number


class PredictionNote(RecordPart):
    """Last prediction of a policy: displacement with one sigma [m], estimated
    parameters in SI.
    """

    displacement: Number
    sigma: Number
    bending_length: EstimatedValue
    retardation_time: EstimatedValue
    yield_curvature: EstimatedValue


class AgreementNote(RecordPart):
    """Agreement of a strip with its model: `residual` [m] of profiles, yield curvature
    [1/m].
    """

    like_model: bool
    residual: Number
    yield_curvature: Number
    reason: str = ""


class WitnessNote(RecordPart):
    """Difference [m] between two measurements of a length, its `spread` [m], `reason`
    to doubt.
    """

    name: str
    difference: Number
    spread: Number
    reason: str = ""


class Result(Recorded):
    """Contents of result.yaml: outcome, time [s] of the layers' touch, lengths [m] at
    the touch.

    A run of the cell adds the reason of its end, its `duration` [s], the `confidence`
    in the touch, `edge_offset` [m] of the laid edges, the `witnesses` that were
    compared, and of a policy that predicts, `foretold` and `agreement`.
    """

    outcome: str = Field(min_length=1)
    t_layer_touch: Number | None = None
    displacement: Number | None = None
    l1: Number | None = None
    l2: Number | None = None
    reason: str | None = None
    duration: Number | None = None
    confidence: Number | None = None
    edge_offset: Number | None = None
    foretold: PredictionNote | None = None
    agreement: AgreementNote | None = None
    witnesses: tuple[WitnessNote, ...] = ()

    def __str__(self) -> str:
        """Line of text with the outcome of the run and, where these were measured,
        displacement and offset of the laid edges.
        """
        lengths = {"displacement": self.displacement, "edges": self.edge_offset}
        known = (
            f"{name} {1e3 * v:+.1f} mm" for name, v in lengths.items() if v is not None
        )
        return ", ".join([self.outcome.replace("_", " "), *known])

    @model_validator(mode="after")
    def _touch_is_whole(self) -> Self:
        needed = ("t_layer_touch", "displacement", "l1", "l2")
        missing = [key for key in needed if getattr(self, key) is None]
        if self.outcome == "layer_touch" and missing:
            raise ValueError(f"outcome layer_touch needs {', '.join(missing)} too")
        return self


def read_result(folder: Path) -> Result | None:
    """Result of the run in `folder`, or None where it has none; ConfigurationError
    where its file is broken.
    """
    path = folder / RESULT
    return load(path, Result, bare=True) if path.exists() else None
