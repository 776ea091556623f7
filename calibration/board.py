"""Calibration marks: the ChArUco board and the pointer, a bright disc on a dark plate;
their detection and their print in true size.
"""

from dataclasses import dataclass
from io import BytesIO
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat

from calibration.lens import Lens
from drivers.base.errors import ConfigurationError
from drivers.base.files import new_file, write_all, writing
from drivers.base.geometry import lengths
from drivers.base.settings import Settings, Share
from drivers.base.types import Array, Image

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Squares = Annotated[int, Field(ge=5, le=25)]
DICTIONARY = cv2.aruco.DICT_5X5_100


class BoardSettings(Settings):
    """Settings of the printed ChArUco board, the required views and the acceptance
    criteria.

    `square` and `marker` are side lengths [m]; `rows` must be odd (older patterns with
    even rows show markers and no corners). `sizes` are the board's width over the
    image's, far and near; `lean` the largest tilt [rad]; ranges are fractions of the
    image.
    """

    columns: Squares = 9
    rows: Squares = 7
    square: float = Field(0.028, gt=0.002, le=0.2)
    marker: float = Field(0.021, gt=0.001, le=0.2)
    sizes: tuple[float, float] = (0.31, 0.40)
    lean: float = Field(radians(32), ge=radians(10), le=radians(50))
    corners: int = Field(16, ge=6)  # that a view must show
    # px, side of a marker, below which corners are coarse
    smallest: float = Field(14.0, gt=4)
    still: float = Field(0.6, gt=0, le=5)  # px between two images of a board at rest
    # px by which a view must differ from every other
    distinct: PositiveFloat = 15.0
    range_x: Share = 0.5  # of the views' centres
    range_y: Share = 0.3
    range_size: Share = 0.08
    skew: Share = 0.25
    views: int = Field(10, ge=6)
    tilted: PositiveFloat = radians(15)  # rad from which a view counts as tilted
    tilted_views: int = Field(2, ge=1)  # that must lean to each of the four sides
    covered: Share = 0.8  # of the image's cells, that corners must reach
    rms: float = Field(0.6, gt=0, le=5)  # px allowed
    # of the focal length, its allowed deviation
    focal: float = Field(0.005, gt=0, le=0.1)
    # allowed difference in focal length of two halves
    split: float = Field(0.02, gt=0, le=0.2)
    # by which the board may be bent, peak to peak
    bow_mm: float = Field(0.3, gt=0, le=5)
    # allowed error of the printed length, its share
    length: float = Field(0.005, gt=0, le=0.05)
    # refused images at one pose before it is given up
    patience: int = Field(3, ge=1, le=50)

    @property
    def width(self) -> float:
        """Length [m] of all columns of squares together, to be checked with a ruler."""
        return self.columns * self.square

    def outline(self) -> Array:
        """Outer corners (4, 2) [m] of the board's pattern, clockwise from top left, y
        down.
        """
        return np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * (
            self.width,
            self.rows * self.square,
        )

    def board(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's object of the calibration board; ConfigurationError for impossible
        sizes.
        """
        rows = self.rows
        if rows % 2 == 0:
            raise ConfigurationError(
                f"board: rows: is {rows}, must be odd; print another"
            )
        if self.marker >= self.square:
            raise ConfigurationError(
                "board: marker: must be smaller than square; measure both"
            )
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        return cv2.aruco.CharucoBoard(
            (self.columns, rows), self.square, self.marker, dictionary
        )


@dataclass(frozen=True, slots=True)
class BoardView:
    """Board corners detected in one view: `ids` (n,), `board` (n, 3) [m], `image` (n,
    2) [px].
    """

    ids: Array
    board: Array
    image: Array

    def distance(self, other: "BoardView") -> float:
        """Median distance [px] of the corners seen in this view and in `other`; inf
        without any.
        """
        _, mine, others = np.intersect1d(self.ids, other.ids, return_indices=True)
        if len(mine) == 0:
            return float("inf")
        return float(np.median(lengths(self.image[mine] - other.image[others])))

    def tilt(self, lens: Lens) -> tuple[float, float]:
        """Two angles [rad] by which the board's top and right edge lean away from the
        camera.
        """
        rotation, _ = self._board_pose(lens)
        return float(np.arcsin(-rotation[2, 1])), float(np.arcsin(rotation[2, 0]))

    def depth(self, lens: Lens) -> float:
        """Distance [m] from the camera to the mean of the corners, along the optical
        axis.
        """
        rotation, shift = self._board_pose(lens)
        middle = rotation @ self.board.mean(axis=0) + shift
        return float(middle[2])

    def _board_pose(self, lens: Lens) -> tuple[Array, Array]:
        """Rotation (3, 3) and shift (3,) [m] from the board's frame to the camera's,
        fitted to the view's corners.
        """
        ideal = lens.undistort(self.image)
        _, turn, shift = cv2.solvePnP(self.board, ideal, lens.matrix, None)
        rotation, _ = cv2.Rodrigues(turn)
        return rotation, shift.ravel()


@dataclass(frozen=True, slots=True)
class BoardDetection:
    """Detection of the board in an image: `view` or None, number of `markers`, mean
    `side` [px].
    """

    view: BoardView | None
    markers: int
    side: float

    @property
    def corners(self) -> int:
        """Number of detected corners of the board."""
        return 0 if self.view is None else len(self.view.ids)


def find_board(
    image: Image, detector: cv2.aruco.CharucoDetector, board: cv2.aruco.CharucoBoard
) -> BoardDetection:
    """Detect `board` in `image` (h, w, 3): its corners, if any, and number and size of
    markers.
    """
    corners, ids, outlines, marks = detector.detectBoard(image)
    markers = 0 if marks is None else len(marks)
    side = 0.0
    if markers:
        corner = np.reshape(outlines, (-1, 4, 2)).astype(np.float64)
        sides = corner - np.roll(corner, 1, axis=1)
        side = float(np.linalg.norm(sides, axis=2).mean())

    # no homography from those
    if ids is None or board.checkCharucoCornersCollinear(ids):
        return BoardDetection(None, markers, side)

    on_board, in_image = board.matchImagePoints(corners, ids)
    view = BoardView(
        np.ravel(ids).astype(np.float64),
        np.reshape(on_board, (-1, 3)).astype(np.float64),
        np.reshape(in_image, (-1, 2)).astype(np.float64),
    )
    return BoardDetection(view, markers, side)


PAPERS = {
    "A4": (297.0, 210.0),
    "A3": (420.0, 297.0),
    "A2": (594.0, 420.0),
    "A1": (841.0, 594.0),
}
QUIET_ZONE = 0.5  # squares of white around the pattern
FOOT = 16.0  # mm under the pattern, for the ruler and the instructions
# px of a square, a multiple of the 7 modules of a marker: its edges stay sharp
SQUARE_PX = 420
PLATE_MM = 14.0  # mm, radius of the pointer's dark plate
DISC_MM = 5.0  # mm, radius of its bright disc
INCHES_PER_MM = 1 / 25.4  # inches


def smallest_sheet(settings: BoardSettings) -> str:
    """Name, one of PAPERS, of the smallest paper that holds the board; raises
    ConfigurationError if none does.
    """
    square = 1e3 * settings.square
    wide = (settings.columns + 2 * QUIET_ZONE) * square
    high = (settings.rows + 2 * QUIET_ZONE) * square + FOOT
    for name, (width, height) in PAPERS.items():
        if wide <= width and high <= height:
            return name
    raise ConfigurationError(
        f"board: {wide:.0f} x {high:.0f} mm fit on no sheet up to A1; make the squares"
        " smaller"
    )


def board_figures(settings: BoardSettings) -> "tuple[Figure, Figure]":
    """Matplotlib figures in true size: the page of the board and the page of the
    pointer.
    """
    sheet = smallest_sheet(settings)
    width, height = PAPERS[sheet]
    page, axes = _blank_page(width, height)
    square = 1e3 * settings.square  # mm
    wide = settings.columns * square
    high = settings.rows * square
    left = (width - wide) / 2
    top = height - QUIET_ZONE * square
    bottom = top - high
    pixels = (settings.columns * SQUARE_PX, settings.rows * SQUARE_PX)
    pattern = settings.board().generateImage(pixels)
    extent = (left, left + wide, bottom, top)
    axes.imshow(
        pattern, cmap="gray", interpolation="none", extent=extent, aspect="auto"
    )
    axes.set(xlim=(0, width), ylim=(0, height))
    _draw_ruler(axes, settings, left, y=bottom - 6.0, name=sheet)
    return page, _pointer_page()


def print_board(settings: BoardSettings, path: Path) -> str:
    """Write the board as a PDF in true size to the new file `path`; returns the paper's
    name.

    Raises ConfigurationError where the file cannot be written or exists already.
    """
    from matplotlib.backends.backend_pdf import PdfPages

    content = BytesIO()
    with PdfPages(content) as pages:
        for figure in board_figures(settings):
            pages.savefig(figure)
    try:
        with writing(path), new_file(path) as file:
            write_all(file, content.getvalue())
    except FileExistsError:
        raise ConfigurationError(
            f"{path}: is there already, and nothing is overwritten; name a new file"
        ) from None
    return smallest_sheet(settings)


def _blank_page(width: float, height: float) -> tuple["Figure", Any]:
    """An empty figure and its axes, in millimetres from the sheet's lower left
    corner.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width * INCHES_PER_MM, height * INCHES_PER_MM))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(0, height)
    return figure, axes


def _draw_ruler(
    axes: Any, settings: BoardSettings, left: float, y: float, name: str
) -> None:
    """Draw a line as long as the board is wide, to check with a ruler, and
    instructions.
    """
    length = 1e3 * settings.width
    axes.plot([left, left + length], [y, y], color="black", linewidth=0.4)
    for end in (left, left + length):
        axes.plot([end, end], [y - 2, y + 2], color="black", linewidth=0.4)
    words = (
        f"Print on {name} at 100 %, glue it on something flat and stiff. Measure this"
        f" line: {length:.1f} mm. ChArUco {settings.columns} x {settings.rows}, squares"
        f" {1e3 * settings.square:g} mm, markers {1e3 * settings.marker:g} mm,"
        " DICT_5X5_100."
    )
    axes.text(left, y - 6.0, words, fontsize=6.5, va="center")


def _pointer_page() -> "Figure":
    """Page with the pointer to cut out: a bright disc on a dark plate."""
    from matplotlib.patches import Circle

    page, axes = _blank_page(*PAPERS["A4"])
    axes.add_patch(Circle((60, 150), PLATE_MM, facecolor="black", linewidth=0))
    axes.add_patch(Circle((60, 150), DISC_MM, facecolor="white", linewidth=0))
    words = (
        "The pointer: cut out the black plate, glue it to a pin that the fingers"
        " hold,\nits disc's centre where the gripper grasps, its face in the plane of"
        f" the strip's\nnear edge. The plate measures {2 * PLATE_MM:.0f} mm, the disc"
        f" {2 * DISC_MM:.0f} mm."
    )
    axes.text(85, 150, words, fontsize=9, va="center")
    return page


# grey levels of the darkest channel of a lit disc, and of one in shadow
LIT_LEVELS = (170, 110)
PLATE_CONTRAST = 90.0  # grey levels between disc and plate
RADII = (3.0, 30.0)  # px, range of radii of the disc
ROUND = 0.75  # share of its circumscribed circle that the disc fills
WINDOW_REACH, PLATE_EDGE, INSIDE = 1.7, 1.25, 0.7  # over the disc's radius
DARK_SHARE = 0.1  # of the contrast, brightness above the plate that carries no weight


def find_pointer(image: Image) -> Array | None:
    """Centre (2,) u, v [px] of the pin's disc in `image` (h, w, 3); None unless exactly
    one.
    """
    darkest = cv2.min(cv2.min(image[..., 0], image[..., 1]), image[..., 2])
    for level in LIT_LEVELS:
        _, bright = cv2.threshold(darkest, level, 255, cv2.THRESH_BINARY)
        outlines, _ = cv2.findContours(bright, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        discs = [_disc(darkest, outline) for outline in outlines]
        centres = [centre for centre in discs if centre is not None]
        if centres:
            return centres[0] if len(centres) == 1 else None
    return None


def _disc(grey: Image, outline: NDArray[np.int32]) -> Array | None:
    """Centre (2,) u, v [px] of the pointer's disc inside `outline`; None without a
    bright disc on a dark plate.
    """
    (u, v), radius = cv2.minEnclosingCircle(outline)
    if not RADII[0] <= radius <= RADII[1]:
        return None
    if cv2.contourArea(outline) < ROUND * np.pi * (radius - 0.5) ** 2:
        return None

    column = round(u)
    row = round(v)
    reach = int(np.ceil(WINDOW_REACH * radius)) + 2
    window = grey[
        max(row - reach, 0) : row + reach + 1,
        max(column - reach, 0) : column + reach + 1,
    ]
    dv, du = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    if window.shape != du.shape:
        return None

    distance = np.hypot(du - (u - column), dv - (v - row))
    beyond_disc = distance > PLATE_EDGE * radius + 1
    plate = np.median(window[beyond_disc & (distance < reach)])
    disc = np.median(window[distance < INSIDE * radius])
    if disc - plate < PLATE_CONTRAST:
        return None

    brightness = (window - plate) / (disc - plate)
    weight = np.clip(brightness - DARK_SHARE, 0.0, 1.0 - DARK_SHARE)
    weight[distance > PLATE_EDGE * radius + 2] = 0.0
    off = np.array([(weight * du).sum(), (weight * dv).sum()]) / weight.sum()
    centre: Array = np.array([column, row]) + off
    return centre
