"""Inputs and results of a run: one context each for a fold, a calibration, a motion by hand."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import degrees

from calibration.calibration import Calibration
from calibration.landmarks import Landmarks
from calibration.wizard.latency import NOT_MEASURED, LatencyVerdict
from calibration.wizard.progress import Observer, ignore
from calibration.wizard.touch_verdict import NOT_TOUCHED, TouchVerdict
from calibration.wizard.touched_points import TouchedPoints
from cell.config.settings import CellSettings
from cell.orchestrator.operator import Operator, Unattended
from cell.orchestrator.outcome import StopReason
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.steps import Motion
from cell.perception.image_reader import Reader
from cell.perception.length_checks import LengthCheck, disagreements
from cell.perception.measurement import SeenTouch
from drivers.arm.obstacles import desk_end
from drivers.strip.file import StripFile
from drivers.types import Pose
from policies.policy import Policy
from policies.prediction import FoldPrediction


class Context(ABC):
    """Base of a run's context: settings, results that most runs leave empty, and its completion."""

    settings: CellSettings
    reader: Reader | None = None
    seen_touch: SeenTouch | None = None
    edge_offset: float | None = None
    predicted: FoldPrediction | None = None
    witnesses: Sequence[LengthCheck] = ()

    @property
    def desk(self) -> float:
        """Position x [m] at which the desk ends: as configured, or the end of the workspace."""
        return desk_end(self.settings.installation)

    @abstractmethod
    def completion(self) -> StopReason:
        """Name, reason and exit code of the run once it has completed."""


@dataclass
class FoldContext(Context):
    """Context of a fold: the controller's knowledge of cell and strip, and the results so far.

    `sight` checks the image of the strip before the grasp, and is the `reader` of images from then
    on. `seen_touch` is the layer_touch once it is seen, `edge_offset` [m] that of the laid edges as
    the camera sees it once the strip was `released`, `predicted` the policy's latest prediction,
    `expected` the displacement and its standard deviation [m] by the model before the fold;
    `witnesses` are what was compared. The grasped edge is laid at `place` [m]. The plant is not
    part of it. `desk` is x [m] of the desk's end, 0 for an arm without a hand. A `warning` of the
    preflight is for the operator.
    """

    settings: CellSettings
    strip: StripFile
    policy: Policy
    calibration: Calibration
    sight: Reader
    reader: Reader | None = None
    seen_touch: SeenTouch | None = None
    edge_offset: float | None = None
    released: bool = False
    predicted: FoldPrediction | None = None
    expected: tuple[float, float] | None = None
    witnesses: list[LengthCheck] = field(default_factory=list)
    place: float = 0.0
    desk: float = 0.0
    warning: str = ""

    def note_expected(self, touch: SeenTouch) -> None:
        """Compare the displacement at `touch` with the policy's prediction, or with the model's."""
        expected, known = self.expected, self.predicted
        if known is not None:
            expected = None if known.blind else (known.displacement, known.sigma)
        if expected is not None:
            off = touch.displacement - expected[0]
            self.witnesses.append(LengthCheck("displacement", off, {"prediction": expected[1]}))

    def completion(self) -> StopReason:
        """Outcome and exit code: 0 where the layers touched and all witnesses agree, else 1."""
        if self.seen_touch is None:
            return StopReason("path_done", "the path ended and no touch was seen", 1)
        if self.released and self.edge_offset is None:
            return StopReason(
                "edges_not_seen",
                "the layers touched, but the camera sees no fold where it was laid: the strip "
                "sprang open or is hidden; look at it, and lay it again",
                1,
            )
        refuted = next((w for w in disagreements(self.witnesses) if w.refuted), None)
        if refuted is None:
            return StopReason("layer_touch", "the layers touch", 0)
        return StopReason(f"{refuted.name}_apart", refuted.sentence(), 1)


@dataclass
class CalibrationContext(Context):
    """Context of a homography calibration: settings, points to touch, operator, and the results.

    The `operator` is asked before the arm moves, `watch` receives its progress. Only a run that
    `remembers` leaves `landmarks`. Where `points` only check a calibration, nothing is fitted.
    No strip is read.
    """

    settings: CellSettings
    points: TouchedPoints
    operator: Operator = field(default_factory=Unattended)
    watch: Observer = ignore
    remembers: bool = False
    touches: TouchVerdict = NOT_TOUCHED
    latency: LatencyVerdict = NOT_MEASURED
    landmarks: Landmarks | None = None

    def completion(self) -> StopReason:
        """Stop reason `calibrated`: all points were touched."""
        return StopReason("calibrated", "all points were touched", 0)


@dataclass
class ManualContext(Context):
    """Context of a manual motion, which `motion` makes from a snapshot; `end` is the last pose."""

    settings: CellSettings
    motion: Callable[[Snapshot], Motion]
    end: Pose | None = None

    def completion(self) -> StopReason:
        """Stop reason `moved`, with the gripper's final pose as text."""
        if self.end is None:
            return StopReason("moved", "", 0)
        x, z = round(1e3 * self.end.x), round(1e3 * self.end.z)
        pitch = round(degrees(self.end.pitch))
        return StopReason("moved", f"the gripper is at x {x}, z {z} mm, pitch {pitch} deg", 0)
