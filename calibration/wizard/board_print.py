"""Printable PDF of the board and the pointer's disc, in true size."""

from io import BytesIO, FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibration.board import BoardSettings
from drivers.errors import ConfigurationError
from drivers.files import new_file, write_all, writing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAPERS = {"A4": (297.0, 210.0), "A3": (420.0, 297.0), "A2": (594.0, 420.0), "A1": (841.0, 594.0)}
QUIET_ZONE = 0.5  # squares of white around the pattern
FOOT = 16.0  # mm under the pattern, for the ruler and the instructions
SQUARE_PX = 420  # px of a square, a multiple of the 7 modules of a marker: its edges stay sharp
PLATE_MM, DISC_MM = 14.0, 5.0  # mm, radii of the pointer's dark plate and bright disc
INCHES_PER_MM = 1 / 25.4  # inches


def smallest_sheet(settings: BoardSettings) -> tuple[str, tuple[float, float]]:
    """Name, width and height [mm] of the smallest sheet for the board, or ConfigurationError."""
    square = 1e3 * settings.square
    wide = (settings.columns + 2 * QUIET_ZONE) * square
    high = (settings.rows + 2 * QUIET_ZONE) * square + FOOT
    for name, (width, height) in PAPERS.items():
        if wide <= width and high <= height:
            return name, (width, height)
    raise ConfigurationError(
        f"board: {wide:.0f} x {high:.0f} mm fit on no sheet up to A1; make the squares smaller"
    )


def board_figures(settings: BoardSettings) -> "tuple[Figure, Figure]":
    """Two matplotlib figures of true size: the page of the board and that of the pointer."""
    name, (width, height) = smallest_sheet(settings)
    page, axes = _blank_page(width, height)
    square = 1e3 * settings.square
    left, top = (width - settings.columns * square) / 2, height - QUIET_ZONE * square
    pixels = (settings.columns * SQUARE_PX, settings.rows * SQUARE_PX)
    pattern = settings.board().generateImage(pixels)
    right, bottom = left + settings.columns * square, top - settings.rows * square
    place = (left, right, bottom, top)
    axes.imshow(pattern, cmap="gray", interpolation="none", extent=place, aspect="auto")
    axes.set(xlim=(0, width), ylim=(0, height))
    _draw_ruler(axes, settings, left, bottom - 6.0, name)
    return page, _pointer_page()


def print_board(settings: BoardSettings, path: Path) -> str:
    """Write the board as a PDF of true size to the new file `path`; returns the sheet's name.

    Raises ConfigurationError where it cannot be written, or something is there already.
    """
    from matplotlib.backends.backend_pdf import PdfPages

    figures, content = board_figures(settings), BytesIO()
    with PdfPages(content) as pages:
        for figure in figures:
            pages.savefig(figure)
    with writing(path), _create(path) as file:
        write_all(file, content.getvalue())
    return smallest_sheet(settings)[0]


def _create(path: Path) -> FileIO:
    try:
        return new_file(path)
    except FileExistsError:
        raise ConfigurationError(
            f"{path}: is there already, and nothing is overwritten; name a new file"
        ) from None


def _blank_page(width: float, height: float) -> tuple["Figure", Any]:
    """An empty figure and its axes, in millimetres from the sheet's lower left corner."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width * INCHES_PER_MM, height * INCHES_PER_MM))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(0, height)
    return figure, axes


def _draw_ruler(axes: Any, settings: BoardSettings, left: float, y: float, name: str) -> None:
    """Draw a line as long as all columns, to check with a ruler, and the instructions."""
    length = 1e3 * settings.width
    axes.plot([left, left + length], [y, y], color="black", linewidth=0.4)
    for end in (left, left + length):
        axes.plot([end, end], [y - 2, y + 2], color="black", linewidth=0.4)
    words = (
        f"Print on {name} at 100 %, glue it on something flat and stiff. Measure this line: "
        f"{length:.1f} mm. ChArUco {settings.columns} x {settings.rows}, "
        f"squares {1e3 * settings.square:g} mm, markers {1e3 * settings.marker:g} mm, DICT_5X5_100."
    )
    axes.text(left, y - 6.0, words, fontsize=6.5, va="center")


def _pointer_page() -> "Figure":
    """Page with the pointer to cut out: a bright disc on a dark plate."""
    from matplotlib.patches import Circle

    page, axes = _blank_page(*PAPERS["A4"])
    axes.add_patch(Circle((60, 150), PLATE_MM, facecolor="black", linewidth=0))
    axes.add_patch(Circle((60, 150), DISC_MM, facecolor="white", linewidth=0))
    words = (
        "The pointer: cut out the black plate, glue it to a pin that the fingers hold,\n"
        "its disc's centre where the gripper grasps, its face in the plane of the strip's\n"
        f"near edge. The plate measures {2 * PLATE_MM:.0f} mm, the disc {2 * DISC_MM:.0f} mm."
    )
    axes.text(85, 150, words, fontsize=9, va="center")
    return page
