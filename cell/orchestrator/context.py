"""What a run is given and what it finds out: one context for a fold, one for a calibration."""

from dataclasses import dataclass

from calibration.calibration import Calibration
from calibration.lens import Lens
from calibration.perception.measurement import SeenTouch
from calibration.touched_points import TouchVerdict
from cell.config.settings import CellSettings
from cell.orchestrator.vision import StripReader
from drivers.strip.file import StripFile
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
    """A calibration of the map to the plane: the lens it starts from, the `touches` it ends with.

    Nothing is read from its images on the way, so that `reader` stays None.
    """

    settings: CellSettings
    lens: Lens
    touches: TouchVerdict | None = None
    reader: None = None


Context = FoldContext | CalibrationContext
