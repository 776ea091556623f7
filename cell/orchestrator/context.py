"""What a run is given and what it finds out: one context for a fold, one for a calibration."""

from dataclasses import dataclass, field

from calibration.calibration import Calibration
from calibration.landmarks import Landmarks
from calibration.lens import Lens
from calibration.perception.measurement import SeenTouch
from calibration.wizard.latency import LatencyVerdict
from calibration.wizard.news import Watcher, nobody
from calibration.wizard.touch_verdict import TouchVerdict
from cell.config.settings import CellSettings
from cell.orchestrator.operator import Operator, Unattended
from cell.orchestrator.vision import StripReader
from drivers.strip.file import StripFile
from drivers.types import Pose
from policies.foretelling import Foretold
from policies.policy import Policy


@dataclass(slots=True)
class FoldContext:
    """A fold: what the controller knows of cell and strip, and what it finds out on the way.

    `reader` reads images from the moment preflight has judged the picture of the strip.
    `seen_touch` is the layer_touch once it is seen, `edge_offset` [m] how far the edges lie apart
    once laid, `foretold` what the policy expected last. The plant is nowhere in here.
    """

    settings: CellSettings
    strip: StripFile
    policy: Policy
    calibration: Calibration
    reader: StripReader | None = None
    seen_touch: SeenTouch | None = None
    edge_offset: float | None = None
    foretold: Foretold | None = None


@dataclass(slots=True)
class CalibrationContext:
    """A calibration of the map to the plane: the lens it starts from, what it ends with.

    The `operator` is asked before the arm moves, `watch` is told all that happens. `plan` are
    other poses than those of the settings. Only a run that `remembers` leaves `landmarks`.
    Nothing is read of a strip on the way, so that `reader` stays None.
    """

    settings: CellSettings
    lens: Lens
    operator: Operator = field(default_factory=Unattended)
    watch: Watcher = nobody
    plan: tuple[Pose, ...] | None = None
    remembers: bool = False
    touches: TouchVerdict | None = None
    latency: LatencyVerdict | None = None
    landmarks: Landmarks | None = None
    reader: None = None


Context = FoldContext | CalibrationContext
