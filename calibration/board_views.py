"""The lens, from views of a board: asks for board poses, is told images, gives a verdict."""

from dataclasses import dataclass

from calibration.lens import LensFit
from drivers.settings import Settings
from drivers.types import Frame


class BoardSettings(Settings):
    """The printed ChArUco board, which views are wanted, and what the verdict demands."""


@dataclass(frozen=True, slots=True)
class BoardPose:
    """Where the board's centre is wanted (x, y, z) [m] in the cell frame, and how it faces.

    Upright and facing the camera's side (normal along -y) at zero; `tilt` [rad] leans its top
    away from the camera, `turn` [rad] moves its right edge away, `roll` [rad] turns it clockwise.
    """

    x: float
    y: float
    z: float
    tilt: float
    turn: float
    roll: float


@dataclass(frozen=True, slots=True)
class LensVerdict:
    """The lens fit, how far two independent halves differ in focal length, and why it fails."""

    fit: LensFit | None
    split: float
    views: int
    reasons: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the lens may be used."""
        return self.fit is not None and not self.reasons


class BoardViews:
    """Ask and tell: the caller brings the board to `ask()` and tells what the camera then saw."""

    def __init__(self, settings: BoardSettings) -> None:
        self._settings = settings

    def ask(self) -> BoardPose | None:
        """Where to hold the board next; None when the views suffice."""
        raise NotImplementedError

    def tell(self, frame: Frame) -> str | None:
        """An image of the board at rest; why it was refused, or None."""
        raise NotImplementedError

    def verdict(self) -> LensVerdict:
        """What the views told so far amount to."""
        raise NotImplementedError
