"""What a run is given and what it finds out: one context for a fold, one for a calibration."""

from collections.abc import Callable
from dataclasses import dataclass

from calibration.calibration import Calibration
from calibration.lens import Lens
from calibration.perception.measurement import SeenTouch
from calibration.touched_points import TouchVerdict
from cell.config.settings import CellSettings
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.steps import Motion
from cell.orchestrator.vision import StripReader
from drivers.strip.file import StripFile
from policies.policy import Policy


@dataclass(slots=True)
class FoldContext:
    """A fold: what the controller knows of cell and strip, and what it finds out on the way.

    `reader` reads images from the moment preflight has judged the picture of the strip.
    `seen_touch` is the layer_touch once it is seen, `edge_offset` [m] where the grasped edge was
    let go. The plant is nowhere in here.
    """

    settings: CellSettings
    strip: StripFile
    policy: Policy
    calibration: Calibration
    reader: StripReader | None = None
    seen_touch: SeenTouch | None = None
    edge_offset: float | None = None


@dataclass(slots=True)
class CalibrationContext:
    """A calibration of the map to the plane: the lens it starts from, the `touches` it ends with.

    Nothing is read from its images on the way, so that `reader` stays None.
    """

    settings: CellSettings
    lens: Lens
    touches: TouchVerdict | None = None
    reader: None = None


@dataclass(slots=True)
class ManualContext:
    """One `motion` by hand, made from the snapshot that it starts at; no image is looked at."""

    settings: CellSettings
    motion: Callable[[Snapshot], Motion]
    reader: None = None


Context = FoldContext | CalibrationContext | ManualContext
