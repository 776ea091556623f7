"""Inputs and results of one run: of a fold, of a calibration, of a manual motion."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from math import degrees

from calibration.calibration import Calibration
from calibration.landmarks import Landmarks
from calibration.wizard.latency import LatencySteps
from calibration.wizard.progress import Observer, ignore
from calibration.wizard.touched_points import TouchedPoints
from cell.base.config.settings import CellSettings
from cell.base.devices.devices import CalibrationAids
from cell.orchestrator.operator import Operator, Unattended
from cell.orchestrator.outcome import Outcome
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.steps import Motion
from cell.perception.image_reader import Reader
from cell.perception.length_checks import LengthCheck, disagreements
from cell.perception.strip_measurement import SeenTouch
from drivers.base.types import Pose
from drivers.franka.obstacles import desk_end
from drivers.strip.file import StripFile
from policies.policy import Policy
from policies.prediction import FoldPrediction


@dataclass
class Context(ABC):
    """Base class of one run's inputs and results: settings, and measurements, empty at
    first.
    """

    settings: CellSettings
    _: KW_ONLY
    reader: Reader | None = None  # only a fold's images are measured
    seen_touch: SeenTouch | None = None
    edge_offset: float | None = None
    predicted: FoldPrediction | None = None
    witnesses: list[LengthCheck] = field(default_factory=list)

    @property
    def desk(self) -> float:
        """Position x [m] of the desk's end: as configured, else the end of the
        workspace.
        """
        return desk_end(self.settings.installation)

    @abstractmethod
    def completion(self) -> Outcome:
        """Outcome of a run without a fault or an interruption, its measurements
        empty.
        """


@dataclass
class FoldContext(Context):
    """Inputs and results of a fold: strip, policy and calibration, and what was
    measured.

    `reader` checks the image of the strip before the grasp, and measures images from
    then on. `seen_touch` is the layer_touch once it is seen, `edge_offset` [m] that of
    the laid edges as the camera sees it once the strip was `released`, `predicted` the
    policy's latest prediction, `expected` the displacement and its standard deviation
    [m] by the model before the fold; `witnesses` are what was compared. The grasped
    edge is laid `place` [m] beyond x = `goal` [m]. The plant is not part of it. `desk`
    is x [m] of the desk's end, 0 for an arm without a hand. A `warning` of the
    preflight is for the operator.
    """

    strip: StripFile
    policy: Policy
    calibration: Calibration
    reader: Reader = field(kw_only=True)
    released: bool = False
    expected: tuple[float, float] | None = None
    place: float = 0.0
    goal: float = 0.0
    desk: float = 0.0
    warning: str = ""

    def check_displacement(self, touch: SeenTouch) -> None:
        """Compare the displacement at `touch` with that predicted by the policy, else
        the model.
        """
        predicted = self.predicted
        expected = self.expected
        if predicted is not None:
            expected = (predicted.displacement, predicted.sigma)
        blind = predicted is not None and predicted.blind
        if expected is not None and not blind:
            displacement, sigma = expected
            difference = touch.displacement - displacement
            self.witnesses.append(
                LengthCheck("displacement", difference, {"prediction": sigma})
            )

    def completion(self) -> Outcome:
        """Outcome of the fold, exit code 0 where the layers touched and lengths
        agree.
        """
        if self.seen_touch is None:
            return Outcome("path_done", "the path ended and no touch was seen", 1)
        if self.released and self.edge_offset is None:
            return Outcome(
                "edges_not_seen",
                "the layers touched, but the camera sees no fold where it was laid: the"
                " strip sprang open or is hidden; look at it, and lay it again",
                1,
            )
        refuted = next((w for w in disagreements(self.witnesses) if w.refuted), None)
        if refuted is None:
            return Outcome("layer_touch", "the layers touch", 0)
        return Outcome(f"{refuted.name}_apart", refuted.sentence(), 1)


@dataclass
class CalibrationContext(Context):
    """Inputs and results of a homography calibration: `points`, touched, and `steps` of
    the arm.

    The `operator` is asked before the arm moves, `watch` receives its progress; on the
    twin its `aids` hold the pointer. Only a run that `remembers` leaves `landmarks`.
    Where `points` only check a calibration, the arm does not step. No strip is read.
    """

    points: TouchedPoints
    operator: Operator = field(default_factory=Unattended)
    watch: Observer = ignore
    aids: CalibrationAids | None = None
    remembers: bool = False
    steps: LatencySteps = field(default_factory=LatencySteps)
    landmarks: Landmarks | None = None

    def completion(self) -> Outcome:
        """Outcome `calibrated`: all points were touched."""
        return Outcome("calibrated", "all points were touched", 0)


@dataclass
class ManualContext(Context):
    """Inputs and results of a manual motion: generator `motion` of commands, final pose
    `end`.
    """

    motion: Callable[[Snapshot], Motion]
    end: Pose | None = None

    def completion(self) -> Outcome:
        """Outcome `moved`, with the gripper's final pose as text."""
        if self.end is None:
            return Outcome("moved", "", 0)
        x, z = round(1e3 * self.end.x), round(1e3 * self.end.z)
        pitch = round(degrees(self.end.pitch))
        return Outcome(
            "moved", f"the gripper is at x {x}, z {z} mm, pitch {pitch} deg", 0
        )
