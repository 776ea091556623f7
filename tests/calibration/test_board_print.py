"""The board on paper: of true size, and the same board that the detector looks for."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from calibration.board import (
    BoardSettings,
    board_figures,
    find_board,
    find_pointer,
    print_board,
    smallest_sheet,
)
from drivers.base.errors import ConfigurationError
from drivers.base.types import Image

SETTINGS = BoardSettings()
DOTS = 127  # per inch: five to a millimetre


def _drawn(figure: Figure) -> Image:
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(DOTS)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def test_printed_squares_are_as_long_as_stated() -> None:
    board = SETTINGS.board()
    image = _drawn(board_figures(SETTINGS)[0])
    look = find_board(image, cv2.aruco.CharucoDetector(board), board)
    assert look.corners == (SETTINGS.columns - 1) * (SETTINGS.rows - 1)
    millimetres = look.view.image.reshape(SETTINGS.rows - 1, -1, 2) / DOTS * 25.4
    assert np.diff(millimetres[..., 0], axis=1) == pytest.approx(28.0, abs=0.02)
    assert np.diff(millimetres[..., 1], axis=0) == pytest.approx(28.0, abs=0.02)
    image[419:] = 255  # one row of corners is left
    assert find_board(image, cv2.aruco.CharucoDetector(board), board).view is None


def test_sheet_of_the_file_is_the_paper_that_is_named(tmp_path: Path) -> None:
    name = print_board(SETTINGS, tmp_path / "board.pdf")
    assert (name, smallest_sheet(SETTINGS)) == ("A3", "A3")
    content = (tmp_path / "board.pdf").read_bytes()
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)
    points = [(float(w) / 72 * 25.4, float(h) / 72 * 25.4) for w, h in boxes]
    assert points == [pytest.approx((420.0, 297.0)), pytest.approx((297.0, 210.0))]
    with pytest.raises(ConfigurationError, match="board: 2000 x 1616 mm"):
        smallest_sheet(BoardSettings(square=0.2, marker=0.1))


def test_printed_pointer_is_found_as_the_pointer() -> None:
    page = _drawn(board_figures(SETTINGS)[1])
    centre = find_pointer(page[: page.shape[0] // 2, : page.shape[1] // 3])
    # its paper is as bright as its disc: the plate must be cut out
    assert centre is None
    cut = page.copy()
    mask = np.zeros(page.shape[:2], np.uint8)
    cv2.circle(mask, (300, 300), 69, 255, -1)
    cut[mask == 0] = 90
    centre = find_pointer(cut)
    assert centre == pytest.approx((299.5, 299.5), abs=0.6)
