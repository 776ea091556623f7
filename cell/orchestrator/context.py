"""What a run knows and learns: settings, strip, calibration, perception, touch."""

from dataclasses import dataclass

from calibration.calibration import Calibration
from calibration.lens import Lens
from calibration.perception.appearance import Appearance
from calibration.perception.layer_touch import LayerTouch
from calibration.perception.perception import Perception
from calibration.perception.sight import SeenTouch
from calibration.touched_points import TouchVerdict
from cell.config.cell import CellFile
from drivers.strip.file import StripFile
from drivers.types import STILL, Velocity
from policies.policy import Policy


@dataclass(slots=True)
class Knowledge:
    """One run's knowledge. The strip is the controller's; the plant is nowhere in here.

    A run given a `lens` and no `calibration` calibrates, and leaves its `touches`; any other run
    folds, and leaves `seen_touch` and `edge_offset` [m].
    """

    settings: CellFile
    strip: StripFile
    policy: Policy
    calibration: Calibration | None = None
    lens: Lens | None = None
    touches: TouchVerdict | None = None
    perception: Perception | None = None
    touch: LayerTouch | None = None
    seen_touch: SeenTouch | None = None
    edge_offset: float | None = None
    velocity: Velocity = STILL

    @property
    def latency(self) -> float:
        """How much earlier than its stamp an image shows the world [s], as far as is known."""
        return self.calibration.latency if self.calibration is not None else 0.0

    def see_with(self, calibration: Calibration, appearance: Appearance) -> None:
        """Start to read images of this strip in this light."""
        settings = self.settings.perception
        self.perception = Perception(calibration, settings, self.strip, appearance)
        self.touch = LayerTouch(settings, self.strip)
