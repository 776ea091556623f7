"""Coverage of the views of a board, gate by gate."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import acos, degrees, pi

import cv2
import numpy as np

from calibration.board_view import BoardView
from calibration.lens import Lens
from drivers.types import Array

CELLS = (4, 3)  # of the image, over which the corners must spread
GUESS = 2.0  # focal length over image width, before any is known


@dataclass(frozen=True, slots=True)
class Placement:
    """Placement of the board in one view, after ROS's camera_calibration.

    `x`, `y` are its centre and `size` the root of its area, as fractions of the image; `skew` is 0
    for a rectangle and 1 for corners 28 degrees off square; `tilt`, `turn` [rad] lean its top and
    its right edge away from the camera.
    """

    x: float
    y: float
    size: float
    skew: float
    tilt: float
    turn: float


@dataclass(frozen=True, slots=True)
class Gate:
    """One coverage requirement: how much the views `have` of the `need`, and the remedy."""

    name: str
    have: float
    need: float
    unit: str
    advice: str

    @property
    def share(self) -> float:
        """Fraction of the need that is met, at most 1."""
        return min(self.have / self.need, 1.0)

    @property
    def passed(self) -> bool:
        """Whether enough is covered."""
        return self.have >= self.need

    def __str__(self) -> str:
        number = "d" if self.unit == "views" else ".2f"
        have = f"{int(self.have):{number}}" if self.unit == "views" else f"{self.have:{number}}"
        need = f"{int(self.need):{number}}" if self.unit == "views" else f"{self.need:{number}}"
        return f"{self.name}: {have} of {need} {self.unit}".rstrip() + f"; {self.advice}"


@dataclass(frozen=True, slots=True)
class CoverageNeeds:
    """Requirements of the gates: ranges of x, y, size, skew, leaning views and
    their angle [rad].
    """

    x: float
    y: float
    size: float
    skew: float
    cells: float
    views: int
    tilted: float
    tilted_views: int


def guessed_lens(size: tuple[int, int]) -> Lens:
    """A lens accurate enough to compute a board's tilt, for images of `size` [px]."""
    width, height = size
    focal = GUESS * width
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    return Lens(width, height, matrix, np.zeros(5))


def placement(view: BoardView, outline: Array, lens: Lens) -> Placement:
    """How `view` shows a board whose outer corners are `outline` (4, 2) [m], clockwise."""
    there, _ = cv2.findHomography(view.board[:, :2], view.image, 0)
    at = np.column_stack([outline, np.ones(4)]) @ there.T
    corners = at[:, :2] / at[:, 2:] / (lens.width, lens.height)
    aspect = np.array([lens.width / lens.height, 1.0])
    before, after = (corners[0] - corners[1]) * aspect, (corners[2] - corners[1]) * aspect
    cosine = float(before @ after / (np.linalg.norm(before) * np.linalg.norm(after)))
    x, y = corners.T
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    tilt, turn = view.tilt(lens)
    return Placement(
        x=float(x.mean()),
        y=float(y.mean()),
        size=area**0.5,
        skew=min(1.0, 2.0 * abs(pi / 2 - acos(np.clip(cosine, -1.0, 1.0)))),
        tilt=tilt,
        turn=turn,
    )


def coverage(
    views: Sequence[BoardView], outline: Array, lens: Lens, needs: CoverageNeeds
) -> tuple[Gate, ...]:
    """Every gate, for `views` of a board with the outer corners `outline` (4, 2) [m]."""
    seen = [placement(view, outline, lens) for view in views]
    tilt, turn = (np.array([getattr(p, name) for p in seen]) for name in ("tilt", "turn"))
    angle = f"by {degrees(needs.tilted):.0f} deg or more"

    def leaning(name: str, angles: Array) -> Gate:
        count = float((angles > needs.tilted).sum())
        return Gate(name, count, needs.tilted_views, "views", f"lean {name} {angle}")

    return (
        Gate("x", _range([p.x for p in seen]), needs.x, "", "show it far left and far right"),
        Gate("y", _range([p.y for p in seen]), needs.y, "", "show it high and low"),
        Gate("size", _range([p.size for p in seen]), needs.size, "", "show it nearer and farther"),
        Gate(
            "skew", max((p.skew for p in seen), default=0.0), needs.skew, "", "lean a corner away"
        ),
        leaning("its top away", tilt),
        leaning("its top nearer", -tilt),
        leaning("its right edge away", turn),
        leaning("its right edge nearer", -turn),
        Gate("image", _cells(views, lens), needs.cells, "", "bring corners to the image's edges"),
        Gate("views", float(len(views)), needs.views, "views", "show more"),
    )


def _range(values: Sequence[float]) -> float:
    return max(values) - min(values) if values else 0.0


def _cells(views: Sequence[BoardView], lens: Lens) -> float:
    """Share of the image's cells that corners reach."""
    if not views:
        return 0.0
    points = np.vstack([view.image for view in views]) / (lens.width, lens.height)
    inside = np.clip(points, 0.0, 0.999999)
    reached = np.unique((inside * CELLS).astype(int) @ (1, CELLS[0]))
    return len(reached) / (CELLS[0] * CELLS[1])
