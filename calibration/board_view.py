"""One view of the calibration board: its corners, on the board and in the image."""

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
        """Median distance [px] of corners that both views show; inf where they share none."""
        _, i, j = np.intersect1d(self.ids, other.ids, return_indices=True)
        if len(i) == 0:
            return float("inf")
        return float(np.median(np.hypot(*(self.image[i] - other.image[j]).T)))

    def tilt(self, lens: Lens) -> tuple[float, float]:
        """Angles [rad] by which the board's top and right edge lean away from the camera."""
        ideal = lens.undistort(self.image)
        _, rotation, _ = cv2.solvePnP(self.board, ideal, lens.matrix, None)
        turned = cv2.Rodrigues(rotation)[0]
        return float(np.arcsin(-turned[2, 1])), float(np.arcsin(turned[2, 0]))


def find_board(
    image: Image, detector: cv2.aruco.CharucoDetector, board: cv2.aruco.CharucoBoard
) -> BoardView | None:
    """The view of `board` in `image` (h, w, 3), or None where no corner is seen."""
    corners, ids, _, _ = detector.detectBoard(image)
    if ids is None or len(ids) == 0:
        return None
    on_board, in_image = board.matchImagePoints(corners, ids)
    return BoardView(
        np.ravel(ids).astype(np.float64),
        np.asarray(on_board, dtype=np.float64).reshape(-1, 3),
        np.asarray(in_image, dtype=np.float64).reshape(-1, 2),
    )
