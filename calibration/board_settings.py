"""Settings of the printed ChArUco board, its required views and the acceptance criteria."""

from math import radians
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from drivers.errors import ConfigurationError
from drivers.settings import Settings
from drivers.types import Array

Squares = Annotated[int, Field(ge=5, le=25)]
DICTIONARY = cv2.aruco.DICT_5X5_100


class BoardSettings(Settings):
    """The printed ChArUco board, the required views, and the acceptance criteria.

    `square` and `marker` are side lengths [m]; `rows` must be odd (older patterns with even rows
    show markers and no corners). `sizes` are the board's width over the image's, far and near;
    `lean` the largest tilt [rad]; ranges are fractions of the image.
    """

    columns: Squares = 9
    rows: Squares = 7
    square: float = Field(0.028, gt=0.002, le=0.2)
    marker: float = Field(0.021, gt=0.001, le=0.2)
    sizes: tuple[float, float] = (0.31, 0.40)
    lean: float = Field(radians(32), ge=radians(10), le=radians(50))
    corners: int = Field(16, ge=6)  # that a view must show
    smallest: float = Field(14.0, gt=4)  # px, side of a marker, below which corners are coarse
    still: float = Field(0.6, gt=0, le=5)  # px between two images of a board at rest
    distinct: float = Field(15.0, gt=0)  # px by which a view must differ from every other
    range_x: float = Field(0.5, gt=0, le=1)  # of the views' centres
    range_y: float = Field(0.3, gt=0, le=1)
    range_size: float = Field(0.08, gt=0, le=1)
    skew: float = Field(0.25, gt=0, le=1)
    views: int = Field(10, ge=6)
    tilted: float = Field(radians(15), gt=0)  # rad from which a view counts as tilted
    tilted_views: int = Field(2, ge=1)  # that must lean to each of the four sides
    covered: float = Field(0.8, gt=0, le=1)  # share of image cells that corners must reach
    rms: float = Field(0.6, gt=0, le=5)  # px allowed
    split: float = Field(0.02, gt=0, le=0.2)  # allowed difference in focal length of two halves
    length: float = Field(0.005, gt=0, le=0.05)  # allowed error of the printed length, its share
    patience: int = Field(3, ge=1, le=50)  # refused images at one pose before it is given up

    @property
    def width(self) -> float:
        """Total length [m] of all columns of squares, to be checked with a ruler."""
        return self.columns * self.square

    def outline(self) -> Array:
        """Outer corners (4, 2) [m] of the pattern, clockwise from its top left, y down."""
        return np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * (self.width, self.rows * self.square)

    def board(self) -> cv2.aruco.CharucoBoard:
        """The board as an OpenCV object; even rows are a ConfigurationError."""
        if self.rows % 2 == 0:
            raise ConfigurationError(f"board: rows: is {self.rows}, must be odd; print another")
        if self.marker >= self.square:
            raise ConfigurationError("board: marker: must be smaller than square; measure both")
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square, self.marker, dictionary
        )
