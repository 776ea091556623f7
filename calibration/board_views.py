"""The lens, from views of a board: asks for board poses, is told images, gives a verdict."""

from dataclasses import dataclass
from math import radians
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from calibration.board_view import BoardView, find_board
from calibration.lens import MINIMUM_VIEWS, Lens, LensFit, fit_lens
from drivers.errors import ConfigurationError
from drivers.settings import Settings
from drivers.types import Frame

Squares = Annotated[int, Field(ge=5, le=25)]
DICTIONARY = cv2.aruco.DICT_5X5_100
CELLS = (4, 3)  # of the image, over which the views must spread


class BoardSettings(Settings):
    """The printed ChArUco board, which views are wanted, and what the verdict demands.

    `square` and `marker` are lengths of sides [m]; `rows` must be odd (older patterns with even
    rows show markers and no corners). `x`, `z` [m] are the middle of the view, `reach` how far
    from it (x, z) board centres go, `depth` the range of y; `lean` the largest tilt [rad].
    """

    columns: Squares = 9
    rows: Squares = 7
    square: float = Field(0.028, gt=0.002, le=0.2)
    marker: float = Field(0.021, gt=0.001, le=0.2)
    x: float = Field(0.31, ge=-1.0, le=2.0)
    z: float = Field(0.16, ge=-0.5, le=1.5)
    reach: tuple[float, float] = (0.24, 0.10)
    depth: tuple[float, float] = (-0.25, 0.10)
    lean: float = Field(radians(32), ge=radians(10), le=radians(50))
    corners: int = Field(16, ge=6)  # that a view must show
    distinct: float = Field(15.0, gt=0)  # px by which a view must differ from every other
    tilted: float = Field(radians(15), gt=0)  # rad from which a view counts as tilted
    tilted_views: int = Field(2, ge=1)  # that must lean to each of the four sides
    covered: float = Field(0.8, gt=0, le=1)  # share of image cells that corners must reach
    rms: float = Field(0.6, gt=0, le=5)  # px allowed
    split: float = Field(0.02, gt=0, le=0.2)  # allowed difference in focal length of two halves
    patience: int = Field(3, ge=1, le=50)  # images at one pose before it is given up

    def board(self) -> cv2.aruco.CharucoBoard:
        """The board as OpenCV knows it; even rows are a ConfigurationError."""
        if self.rows % 2 == 0:
            raise ConfigurationError(f"board: rows: is {self.rows}, must be odd; print another")
        if self.marker >= self.square:
            raise ConfigurationError("board: marker: must be smaller than square; measure both")
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square, self.marker, dictionary
        )


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
        self._board = settings.board()
        self._detector = cv2.aruco.CharucoDetector(self._board)
        self._plan = _plan(settings)
        self._at = 0
        self._tries = 0
        self._views: list[BoardView] = []
        self._size: tuple[int, int] | None = None

    def ask(self) -> BoardPose | None:
        """Where to hold the board next; None when the views suffice."""
        return self._plan[self._at] if self._at < len(self._plan) else None

    def tell(self, frame: Frame) -> str | None:
        """An image of the board at rest; why another is needed, or None.

        After `patience` refused images the pose is given up.
        """
        self._tries += 1
        refused = self._take(frame)
        if refused is None or self._tries >= self._settings.patience:
            self._at += 1
            self._tries = 0
        return refused

    def verdict(self) -> LensVerdict:
        """What the views told so far amount to."""
        if self._size is None or len(self._views) < 2 * MINIMUM_VIEWS:
            reason = f"{len(self._views)} views, at least {2 * MINIMUM_VIEWS} are needed; show more"
            return LensVerdict(None, float("nan"), len(self._views), (reason,))
        fit = _fit(self._views, self._size)
        halves = [_fit(self._views[start::2], self._size).lens.matrix[0, 0] for start in (0, 1)]
        split = abs(halves[0] - halves[1]) / float(fit.lens.matrix[0, 0])
        reasons = [*self._uncovered(fit.lens)]
        if fit.rms > self._settings.rms:
            reasons.append(
                f"corners are {fit.rms:.2f} px off, allowed {self._settings.rms:.2f}; "
                "hold the board still and flat"
            )
        if split > self._settings.split:
            reasons.append(
                f"two halves of the views differ by {100 * split:.1f} % in focal length, allowed "
                f"{100 * self._settings.split:.1f} %; tilt the board more"
            )
        return LensVerdict(fit, split, len(self._views), tuple(reasons))

    def _take(self, frame: Frame) -> str | None:
        size = (frame.image.shape[1], frame.image.shape[0])
        if self._size is not None and size != self._size:
            return f"the image is {size[0]} x {size[1]} pixels, the others {self._size}"
        view = find_board(frame.image, self._detector, self._board)
        if view is None or len(view.ids) < self._settings.corners:
            seen = 0 if view is None else len(view.ids)
            return (
                f"{seen} corners of the board are seen, {self._settings.corners} are needed; "
                "bring it into the image, light it"
            )
        moved = min((view.distance(other) for other in self._views), default=np.inf)
        if moved < self._settings.distinct:
            return f"a view that differs by only {moved:.0f} px was taken before; move the board"
        self._size = size
        self._views.append(view)
        return None

    def _uncovered(self, lens: Lens) -> list[str]:
        """What the views lack of tilt and of the image."""
        tilts = np.array([view.tilt(lens) for view in self._views])
        limit = self._settings.tilted
        sides = {
            "its top away": tilts[:, 0] > limit,
            "its top nearer": tilts[:, 0] < -limit,
            "its right edge away": tilts[:, 1] > limit,
            "its right edge nearer": tilts[:, 1] < -limit,
        }
        lacking = [
            f"{int(seen.sum())} views with {side}, {self._settings.tilted_views} are needed"
            for side, seen in sides.items()
            if seen.sum() < self._settings.tilted_views
        ]
        points = np.vstack([view.image for view in self._views]) / (lens.width, lens.height)
        cells = np.unique((points * CELLS).astype(int) @ (1, CELLS[0]))
        share = len(cells) / (CELLS[0] * CELLS[1])
        if share < self._settings.covered:
            lacking.append(f"corners reach {100 * share:.0f} % of the image; go to its edges")
        return lacking


def _plan(settings: BoardSettings) -> tuple[BoardPose, ...]:
    """Twelve views: five places, four leans and four leans with roll, near and far."""
    lean, (dx, dz), (near, far) = settings.lean, settings.reach, settings.depth
    wanted = [
        (0, 0, 0, 0, 0, 0.0),
        (-1, 1, 0, 0.5, 0.5, 0.0),
        (1, -1, 0, -0.5, -0.5, 0.0),
        (-1, -1, 1, -0.5, 0.5, 0.0),
        (1, 1, 1, 0.5, -0.5, 0.0),
        (0.3, 0, 1, 1, 0, 0.1),
        (-0.3, 0, 1, -1, 0, -0.1),
        (0.4, 0, 0, 0, 1, 0.1),
        (-0.4, 0, 0, 0, -1, -0.1),
        (1, 0, 0, 0.8, 0.8, 0.2),
        (-1, 0, 0, -0.8, -0.8, -0.2),
        (0, 1, 0, 0.8, -0.8, 0.3),
        (0, -1, 0, -0.8, 0.8, -0.3),
    ]
    return tuple(
        BoardPose(
            x=settings.x + u * dx,
            y=far if back else near,
            z=settings.z + v * dz,
            tilt=tilt * lean,
            turn=turn * lean,
            roll=roll,
        )
        for u, v, back, tilt, turn, roll in wanted
    )


def _fit(views: list[BoardView], size: tuple[int, int]) -> LensFit:
    return fit_lens([view.board for view in views], [view.image for view in views], size)
