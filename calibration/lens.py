"""Lens model: pinhole with Brown distortion, calibrated from views of a ChArUco board."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import cv2
import numpy as np
from pydantic import Field

from drivers.errors import ConfigurationError
from drivers.settings import Settings
from drivers.types import Array, frozen

CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
MINIMUM_VIEWS = 3


@dataclass(frozen=True, slots=True)
class Lens:
    """Camera matrix (3, 3) [px] and distortion k1 k2 p1 p2 k3 (5,) for one image size [px]."""

    width: int
    height: int
    matrix: Array
    distortion: Array

    def undistort(self, pixels: Array) -> Array:
        """Ideal pinhole points (n, 2) [px] of image points (n, 2) [px]."""
        points = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if len(points) == 0:
            return np.empty((0, 2))
        ideal = cv2.undistortPoints(
            points, self.matrix, self.distortion, P=self.matrix, criteria=CRITERIA
        )
        return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)

    def distort(self, pixels: Array) -> Array:
        """Image points (n, 2) [px] of ideal pinhole points (n, 2) [px]; inverse of undistort."""
        points = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        if len(points) == 0:
            return np.empty((0, 2))
        rays = np.linalg.solve(self.matrix, np.column_stack([points, np.ones(len(points))]).T).T
        image, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), self.matrix, self.distortion)
        return np.asarray(image, dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True, slots=True)
class LensFit:
    """A lens and its fit quality: rms [px], rms per view (n,), focal length's
    standard deviation [px].
    """

    lens: Lens
    rms: float
    per_view: Array
    focal_deviation: float


def fit_lens(
    object_points: Sequence[Array], image_points: Sequence[Array], size: tuple[int, int]
) -> LensFit:
    """Lens from board corners: per view (m, 3) [m] on the board and (m, 2) [px] in the image.

    `size` is (width, height) [px]. Fewer than three views, or corners outside of an image of that
    size, are a ConfigurationError.
    """
    if len(object_points) < MINIMUM_VIEWS:
        raise ConfigurationError(
            f"lens: {len(object_points)} board views, at least {MINIMUM_VIEWS} are needed; add more"
        )
    _check_inside(np.vstack(list(image_points)), size)
    rms, matrix, distortion, _, _, deviations, _, per_view = cv2.calibrateCameraExtended(
        [np.float32(p).reshape(-1, 1, 3) for p in object_points],
        [np.float32(p).reshape(-1, 1, 2) for p in image_points],
        size,
        None,
        None,
        flags=cv2.CALIB_FIX_K3,
    )
    lens = Lens(size[0], size[1], frozen(matrix), frozen(np.ravel(distortion)[:5]))
    return LensFit(lens, float(rms), frozen(np.ravel(per_view)), float(np.ravel(deviations)[0]))


def _check_inside(points: Array, size: tuple[int, int]) -> None:
    """Refuse points (n, 2) [px] outside an image of `size`; OpenCV does not check."""
    width, height = size
    u, v = points.max(axis=0)
    if u > width or v > height:
        raise ConfigurationError(
            f"lens: a corner at u {u:.0f}, v {v:.0f} px lies outside of an image of "
            f"{width} x {height} px; state its width first, then its height"
        )


Positive = Annotated[int, Field(gt=0)]


class MatrixFile(Settings):
    """A matrix in ROS format."""

    rows: Positive
    cols: Positive
    data: tuple[float, ...]

    @classmethod
    def of(cls, matrix: Array) -> Self:
        """`matrix` (rows, cols), row by row."""
        rows, cols = matrix.shape
        return cls(rows=rows, cols=cols, data=tuple(float(value) for value in matrix.ravel()))

    def array(self, shape: tuple[int, int], origin: str) -> Array:
        """The matrix as an array of `shape`; another shape is a ConfigurationError."""
        if (self.rows, self.cols) != shape or len(self.data) != shape[0] * shape[1]:
            raise ConfigurationError(f"{origin}: must be {shape[0]} x {shape[1]} numbers")
        return frozen(np.reshape(self.data, shape))


class CameraFile(Settings):
    """ROS camera_info, the calibration format of image_pipeline."""

    image_width: Positive
    image_height: Positive
    camera_name: str
    camera_matrix: MatrixFile
    distortion_model: Literal["plumb_bob"] = "plumb_bob"
    distortion_coefficients: MatrixFile
    rectification_matrix: MatrixFile
    projection_matrix: MatrixFile

    @classmethod
    def of(cls, lens: Lens, name: str) -> Self:
        """The file that describes `lens` of the camera `name`."""
        projection = np.column_stack([lens.matrix, np.zeros(3)])
        return cls(
            image_width=lens.width,
            image_height=lens.height,
            camera_name=name,
            camera_matrix=MatrixFile.of(lens.matrix),
            distortion_coefficients=MatrixFile.of(lens.distortion[None]),
            rectification_matrix=MatrixFile.of(np.eye(3)),
            projection_matrix=MatrixFile.of(projection),
        )

    def lens(self, origin: str) -> Lens:
        """The lens; matrices of a wrong shape are a ConfigurationError that names `origin`."""
        matrix = self.camera_matrix.array((3, 3), f"{origin}: camera_matrix")
        distortion = self.distortion_coefficients.array(
            (1, 5), f"{origin}: distortion_coefficients"
        )
        return Lens(self.image_width, self.image_height, matrix, frozen(distortion.ravel()))

    def content(self) -> dict[str, Any]:
        """Plain mapping for YAML or JSON."""
        return self.model_dump(mode="json")
