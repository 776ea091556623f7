"""The map to the plane, by touching: asks for gripper poses, is told images, gives a verdict."""

from dataclasses import dataclass

from calibration.homography import Homography, Rejected
from calibration.lens import Lens
from drivers.settings import Settings
from drivers.types import Frame, Pose


class TouchSettings(Settings):
    """Where to touch, how often to look, and what the verdict demands."""


@dataclass(frozen=True, slots=True)
class TouchVerdict:
    """The map, its rms and worst distance [mm] at points not used in the fit, and why it fails.

    `rejected` names fitted points that disagree; `reasons` is empty when `passed`.
    """

    homography: Homography | None
    residual_mm: float
    worst_mm: float
    used: int
    held_out: int
    rejected: tuple[Rejected, ...]
    reasons: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the map may be used."""
        return self.homography is not None and not self.reasons


class TouchedPoints:
    """Ask and tell: the caller moves the pointer to `ask()` and tells what the camera then saw."""

    def __init__(self, lens: Lens, settings: TouchSettings) -> None:
        self._lens = lens
        self._settings = settings

    def ask(self) -> Pose | None:
        """Where to bring the pointer next and hold it still; None when there is enough."""
        raise NotImplementedError

    def tell(self, frame: Frame, pose: Pose) -> str | None:
        """An image of the pointer at rest at the measured `pose`; why it was refused, or None."""
        raise NotImplementedError

    def verdict(self) -> TouchVerdict:
        """What the points told so far amount to."""
        raise NotImplementedError
