"""One view of the calibration board: its corners on the board and in the image."""

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.lens import Lens
from drivers.types import Array, Image


@dataclass(frozen=True, slots=True)
class BoardView:
    """Corners of one view: `ids` (n,), `board` (n, 3) [m] on it, `image` (n, 2) [px]."""

    ids: Array
    board: Array
    image: Array

    def distance(self, other: "BoardView") -> float:
        """Median distance [px] of corners common to both views; inf without any."""
        _, i, j = np.intersect1d(self.ids, other.ids, return_indices=True)
        if len(i) == 0:
            return float("inf")
        return float(np.median(np.hypot(*(self.image[i] - other.image[j]).T)))

    def tilt(self, lens: Lens) -> tuple[float, float]:
        """Angles [rad] by which the board's top and right edge lean away from the camera."""
        turned = cv2.Rodrigues(self._pose(lens)[0])[0]
        return float(np.arcsin(-turned[2, 1])), float(np.arcsin(turned[2, 0]))

    def depth(self, lens: Lens) -> float:
        """Distance [m] from the camera to the middle of the corners, along the optical axis."""
        rotation, shift = self._pose(lens)
        middle = cv2.Rodrigues(rotation)[0] @ self.board.mean(axis=0) + shift.ravel()
        return float(middle[2])

    def _pose(self, lens: Lens) -> tuple[Array, Array]:
        ideal = lens.undistort(self.image)
        _, rotation, shift = cv2.solvePnP(self.board, ideal, lens.matrix, None)
        return rotation, shift


@dataclass(frozen=True, slots=True)
class BoardLook:
    """Detection of the board in one image: the `view`, None without a corner, the number of
    `markers` and their mean `side` [px].
    """

    view: BoardView | None
    markers: int
    side: float

    @property
    def corners(self) -> int:
        """Number of detected corners."""
        return 0 if self.view is None else len(self.view.ids)


def find_board(
    image: Image, detector: cv2.aruco.CharucoDetector, board: cv2.aruco.CharucoBoard
) -> BoardLook:
    """Detection of `board` in `image` (h, w, 3)."""
    corners, ids, outlines, marks = detector.detectBoard(image)
    markers = 0 if marks is None else len(marks)
    side = _side(outlines) if markers else 0.0
    if ids is None or len(ids) == 0:
        return BoardLook(None, markers, side)
    on_board, in_image = board.matchImagePoints(corners, ids)
    view = BoardView(
        np.ravel(ids).astype(np.float64),
        np.asarray(on_board, dtype=np.float64).reshape(-1, 3),
        np.asarray(in_image, dtype=np.float64).reshape(-1, 2),
    )
    return BoardLook(view, markers, side)


def _side(outlines: object) -> float:
    """Mean side [px] of marker outlines, each (4, 2)."""
    square = np.asarray(outlines, dtype=np.float64).reshape(-1, 4, 2)
    return float(np.hypot(*np.moveaxis(square - np.roll(square, 1, axis=1), -1, 0)).mean())
