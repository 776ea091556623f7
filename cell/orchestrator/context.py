"""Inputs of one run, and the log of what it found: of a fold, a calibration, a manual
motion.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from math import degrees

from calibration.calibration import Calibration
from calibration.view import Landmarks
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
from cell.perception.length_checks import REFUTED, LengthCheck, disagreements, doubts
from cell.perception.strip_measurement import SeenTouch
from drivers.base.types import Pose
from drivers.franka.shapes import desk_end
from drivers.strip.file import StripFile
from policies.policy import FoldPrediction, Policy


@dataclass(frozen=True, slots=True)
class Inputs:
    """Base class of what one run is given: settings, and for a fold a reader of
    images.

    `desk` [m] is x of the desk's end, None for the one of the installation.
    """

    settings: CellSettings
    _: KW_ONLY
    reader: Reader | None = None  # only a fold's images are measured
    desk: float | None = None

    @property
    def desk_end(self) -> float:
        """Position x [m] of the desk's end: `desk` where it is given, else the one that
        the installation states.
        """
        if self.desk is not None:
            return self.desk
        return desk_end(self.settings.installation)


@dataclass(slots=True)
class Log(ABC):
    """Base class of what one run has found; all fields are empty at its start.

    `seen_touch` is the layer_touch once it is seen, `edge_offset` [m] that of the laid
    edges as the camera sees it, `predicted` the policy's latest prediction;
    `witnesses` are what was compared.
    """

    seen_touch: SeenTouch | None = None
    edge_offset: float | None = None
    predicted: FoldPrediction | None = None
    witnesses: list[LengthCheck] = field(default_factory=list)

    @abstractmethod
    def completion(self) -> Outcome:
        """Outcome of a run without a fault or an interruption, its measurements
        empty.
        """


@dataclass(frozen=True, slots=True)
class FoldInputs(Inputs):
    """Inputs of a fold: strip, policy, calibration, and how the fold is to end.

    `reader` checks the image of the strip before the grasp, and measures images from
    then on. The `desk` ends at 0 for an arm without a hand. `expected` are the
    displacement and its standard deviation [m] by the model before the fold. The
    grasped edge is laid `place` [m] beyond x = `goal` [m]. The plant is not part of it.
    """

    strip: StripFile
    policy: Policy
    calibration: Calibration
    reader: Reader = field(kw_only=True)
    desk: float | None = field(default=0.0, kw_only=True)
    expected: tuple[float, float] | None = field(default=None, kw_only=True)
    place: float = field(default=0.0, kw_only=True)
    goal: float = field(default=0.0, kw_only=True)


@dataclass(slots=True)
class FoldLog(Log):
    """Findings of a fold: whether the strip was `released`, and the preflight's
    `warning` for the operator.

    Of the pushes of the laid edge its bent layer took up `bent` [m], by the camera; 0
    unless they end with the edge in place.
    """

    released: bool = False
    bent: float = 0.0
    warning: str = ""

    def check_displacement(
        self, touch: SeenTouch, expected: tuple[float, float] | None
    ) -> None:
        """Compare the displacement measured at `touch` with the policy's prediction or,
        without one, with `expected`.
        """
        predicted = self.predicted
        if predicted is not None:
            told = (predicted.displacement, predicted.sigma)
            expected = None if predicted.blind else told
        if expected is not None:
            displacement, sigma = expected
            difference = touch.displacement - displacement
            self.witnesses.append(LengthCheck("displacement", difference, sigma))

    def completion(self) -> Outcome:
        """Outcome of the fold; its exit code is 0 where the layers touched and all
        compared lengths agree.
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
        refuted = disagreements(self.witnesses, REFUTED)
        if refuted:
            name = refuted[0].name
            return Outcome(f"{name}_apart", doubts(self.witnesses)[name], 1)
        return Outcome("layer_touch", "the layers touch", 0)


@dataclass(frozen=True, slots=True)
class CalibrationInputs(Inputs):
    """Inputs of a homography calibration: the `points` to touch, who answers its
    questions, and who watches it.

    The `operator` is asked before the arm moves, `watch` receives its progress; on the
    twin its `aids` hold the pointer. Only a run that `remembers` leaves landmarks.
    Where `points` only check a calibration, the arm does not step. No strip is read.
    """

    points: TouchedPoints
    operator: Operator = field(default_factory=Unattended)
    watch: Observer = ignore
    aids: CalibrationAids | None = None
    remembers: bool = False


@dataclass(slots=True)
class CalibrationLog(Log):
    """Findings of a homography calibration besides its points: the arm's `steps`, and
    the landmarks.
    """

    steps: LatencySteps = field(default_factory=LatencySteps)
    landmarks: Landmarks | None = None

    def completion(self) -> Outcome:
        """Outcome `calibrated` with exit code 0, which states that all points were
        touched.
        """
        return Outcome("calibrated", "all points were touched", 0)


@dataclass(frozen=True, slots=True)
class ManualInputs(Inputs):
    """Inputs of a manual motion: `motion`, a function that returns the generator of its
    commands.
    """

    motion: Callable[[Snapshot], Motion]


@dataclass(slots=True)
class ManualLog(Log):
    """Findings of a manual motion: the gripper's pose at its `end`, None until it has
    ended.
    """

    end: Pose | None = None

    def completion(self) -> Outcome:
        """Outcome `moved`, with the gripper's final pose as text."""
        ended = self.end
        if ended is None:
            return Outcome("moved", "", 0)
        x, z = round(1e3 * ended.x), round(1e3 * ended.z)
        pitch = round(degrees(ended.pitch))
        return Outcome(
            "moved", f"the gripper is at x {x}, z {z} mm, pitch {pitch} deg", 0
        )
