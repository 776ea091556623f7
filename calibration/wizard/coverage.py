"""Required views of the calibration board, and how well the accepted views cover
them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import acos, degrees, pi

import cv2
import numpy as np

from calibration.board import BoardSettings, BoardView
from calibration.lens import Lens
from drivers.base.types import Array, BoardPlacement

MIDDLE_SHARE = 0.05  # share of the image within which a place is called the middle
FLAT_ANGLE = 0.05  # rad under which a lean is not mentioned


class WantedView(BoardPlacement):
    """View of the calibration board that is required, by the board's position, size and
    angles in the image.
    """

    __slots__ = ()

    def __str__(self) -> str:
        words = (_words(self.y, "high", "low"), _words(self.x, "left", "right"))
        where = (
            " and ".join(word for word in words if word != "middle") or "in the middle"
        )
        leans = [
            _lean_words(self.tilt, "top away", "top nearer"),
            _lean_words(self.turn, "right edge away", "right edge nearer"),
            _lean_words(self.roll, "turned clockwise", "turned anticlockwise"),
        ]
        how = ", ".join(filter(None, leans)) or "facing the camera"
        return f"{where}, {100 * self.size:.0f} % of the image wide, {how}"

    def outline(self, corners: Array, lens: Lens) -> Array:
        """Points [px] of shape (4, 2) at which an image through `lens` shows the
        board's outer `corners` [m] of the same shape in the wanted view.
        """
        from scipy.spatial.transform import Rotation  # half a second that no fold needs

        matrix = lens.matrix
        angles = (self.roll, -self.tilt, -self.turn)
        rotation = Rotation.from_euler("zxy", angles).as_rotvec()
        board_width = np.ptp(corners[:, 0])
        depth = matrix[0, 0] * board_width / (self.size * lens.width)

        middle = np.array([self.x * lens.width, self.y * lens.height, 1.0])
        translation = np.linalg.solve(matrix, middle) * depth
        flat = np.column_stack([corners - corners.mean(axis=0), np.zeros(len(corners))])
        image, _ = cv2.projectPoints(flat, rotation, translation, matrix, None)
        outline: Array = image.reshape(-1, 2)
        return outline


def wanted_views(lean: float, sizes: tuple[float, float]) -> tuple[WantedView, ...]:
    """The thirteen required views of the board: five positions in the image, four
    leaning boards, and four that lean and are rolled too.

    Positions are fractions of the image, `sizes` those of its width that the board
    fills, far and near; `lean` [rad] is the largest tilt.
    """
    far, near = sizes
    right, left, high, low = 0.84, 0.16, 0.27, 0.73
    half = 0.5 * lean
    most = 0.8 * lean
    return (
        WantedView(0.5, 0.5, near),
        WantedView(left, high, near, tilt=half, turn=half),
        WantedView(right, low, near, tilt=-half, turn=-half),
        WantedView(left, low, far, tilt=-half, turn=half),
        WantedView(right, high, far, tilt=half, turn=-half),
        WantedView(0.6, 0.5, far, tilt=lean, roll=0.1),
        WantedView(0.4, 0.5, far, tilt=-lean, roll=-0.1),
        WantedView(0.65, 0.5, near, turn=lean, roll=0.1),
        WantedView(0.35, 0.5, near, turn=-lean, roll=-0.1),
        WantedView(right, 0.5, near, tilt=most, turn=most, roll=0.2),
        WantedView(left, 0.5, near, tilt=-most, turn=-most, roll=-0.2),
        WantedView(0.5, high, near, tilt=most, turn=-most, roll=0.3),
        WantedView(0.5, low, near, tilt=-most, turn=most, roll=-0.3),
    )


def _words(share: float, low: str, high: str) -> str:
    """Word for a position at the fraction `share` of the image's width or height: the
    word `low`, "middle" or the word `high`.
    """
    if abs(share - 0.5) <= MIDDLE_SHARE:
        return "middle"
    return low if share < 0.5 else high


def _lean_words(angle: float, positive: str, negative: str) -> str:
    """Text on a board that leans by `angle` [rad], with the words `positive` or
    `negative` for the side; empty where it does not lean.
    """
    if abs(angle) < FLAT_ANGLE:
        return ""
    return f"{positive if angle > 0 else negative} by {degrees(abs(angle)):.0f} deg"


COVERAGE_CELLS = (4, 3)  # of the image, over which the corners must spread
# of the image, so that a corner on its edge falls into the last cell
BELOW_ONE = 0.999999
GUESS = 2.0  # focal length over image width, before any is known


@dataclass(frozen=True, slots=True)
class Placement:
    """Position, size, skew and lean of the calibration board in one view, with the same
    measures as ROS's camera_calibration.

    `x`, `y` are its centre and `size` the root of its area, as fractions of the image;
    `skew` is 0 for a rectangle and 1 for corners 28 degrees off square; `tilt`, `turn`
    [rad] lean its top and its right edge away from the camera.
    """

    x: float
    y: float
    size: float
    skew: float
    tilt: float
    turn: float


@dataclass(frozen=True, slots=True)
class Gate:
    """Requirement on how well the views cover the image: they reach `have` of `need`,
    counted in `unit`, and `advice` says what to show next.
    """

    name: str
    have: float
    need: float
    advice: str
    unit: str = ""

    @property
    def share(self) -> float:
        """Fraction of the requirement that the views reach, at most 1."""
        return min(self.have / self.need, 1.0)

    @property
    def passed(self) -> bool:
        """Whether the accepted views meet this requirement."""
        return self.have >= self.need

    @property
    def ratio(self) -> str:
        """Text `have of need` with the two numbers, which are whole where views are
        counted.
        """
        digits = 0 if self.unit else 2
        return f"{self.have:.{digits}f} of {self.need:.{digits}f}"

    def __str__(self) -> str:
        return f"{self.name}: {self.ratio} {self.unit}".rstrip() + f"; {self.advice}"


def guessed_lens(size: tuple[int, int]) -> Lens:
    """Typical lens for images of width and height `size` [px], accurate enough to
    compute how a board is tilted.
    """
    width, height = size
    return Lens.pinhole(size, GUESS * width, ((width - 1) / 2, (height - 1) / 2))


@dataclass(frozen=True, slots=True, eq=False)
class Sketch:
    """Outer corners of the board in an image [px], a row for each of the four, as
    `wanted` and as `seen`; None where these are unknown.

    `size` is the (width, height) [px] of the image.
    """

    size: tuple[int, int]
    wanted: Array | None
    seen: Array | None


def project_outline(view: BoardView, outline: Array) -> Array:
    """Points [px] of shape (4, 2) at which the image of `view` shows the board's outer
    corners `outline` [m] of the same shape.
    """
    to_image, _ = cv2.findHomography(view.board[:, :2], view.image, 0)
    corners: Array = cv2.perspectiveTransform(outline[None], to_image)[0]
    return corners


def placement(view: BoardView, outline: Array, lens: Lens) -> Placement:
    """Position, size and lean, in the image of `view`, of a board with the outer
    corners `outline` [m] of shape (4, 2), clockwise.
    """
    corners = project_outline(view, outline) / lens.size
    x, y = corners.T
    # shoelace formula
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))

    # angle between two sides, as in ROS's camera calibrator
    aspect = np.array([lens.width / lens.height, 1.0])
    top = (corners[0] - corners[1]) * aspect
    right = (corners[2] - corners[1]) * aspect
    cosine = top @ right / (np.linalg.norm(top) * np.linalg.norm(right))
    angle = acos(np.clip(cosine, -1.0, 1.0))

    tilt, turn = view.tilt(lens)
    return Placement(
        x=float(x.mean()),
        y=float(y.mean()),
        size=area**0.5,
        skew=min(1.0, 2.0 * abs(pi / 2 - angle)),
        tilt=tilt,
        turn=turn,
    )


def gates(
    views: Sequence[BoardView], lens: Lens, needs: BoardSettings
) -> tuple[Gate, ...]:
    """All requirements on how the views cover the image, and how far `views`, seen
    through `lens`, meet them.
    """
    placed = [placement(view, needs.outline(), lens) for view in views]
    no_view = [(0.0, 0.0, 0.0)]  # spans nothing, before the first view
    x, y, size = np.ptp(
        [(p.x, p.y, p.size) for p in placed] or no_view, axis=0
    ).tolist()
    skew = max((p.skew for p in placed), default=0.0)
    covered = _cell_share(views, lens)
    tilts = np.array([p.tilt for p in placed])
    turns = np.array([p.turn for p in placed])
    return (
        Gate(
            name="x",
            have=x,
            need=needs.range_x,
            advice="show it far left and far right",
        ),
        Gate(name="y", have=y, need=needs.range_y, advice="show it high and low"),
        Gate(
            name="size",
            have=size,
            need=needs.range_size,
            advice="show it nearer and farther",
        ),
        Gate(name="skew", have=skew, need=needs.skew, advice="lean a corner away"),
        _lean_gate("its top away", tilts, needs),
        _lean_gate("its top nearer", -tilts, needs),
        _lean_gate("its right edge away", turns, needs),
        _lean_gate("its right edge nearer", -turns, needs),
        Gate(
            name="image",
            have=covered,
            need=needs.covered,
            advice="bring corners to the image's edges",
        ),
        Gate(
            name="views",
            have=len(views),
            need=needs.views,
            advice="show more",
            unit="views",
        ),
    )


def _lean_gate(name: str, angles: Array, needs: BoardSettings) -> Gate:
    """Requirement that enough of the views lean in the direction `name`: enough of
    `angles` [rad] must lie beyond a threshold.
    """
    count = int((angles > needs.tilted).sum())
    advice = f"lean {name} by {degrees(needs.tilted):.0f} deg or more"
    return Gate(
        name=name, have=count, need=needs.tilted_views, advice=advice, unit="views"
    )


def _cell_share(views: Sequence[BoardView], lens: Lens) -> float:
    """Fraction of the cells of a coarse grid over the image in which corners of the
    board were found in any of `views`.
    """
    if not views:
        return 0.0
    points = np.vstack([view.image for view in views]) / lens.size
    columns, rows = COVERAGE_CELLS
    cells = (np.clip(points, 0.0, BELOW_ONE) * COVERAGE_CELLS).astype(int)
    reached = np.unique(cells @ (1, columns))  # numbers of the cells, row by row
    return len(reached) / (columns * rows)
