"""Lens model (pinhole, Brown distortion), its fit to views of a board, its ROS and
OpenCV files.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import cv2
import numpy as np
from numpy.typing import ArrayLike
from pydantic import PositiveInt

from drivers.base.errors import ConfigurationError
from drivers.base.files import write_file
from drivers.base.readers import read_text
from drivers.base.settings import Settings, load, parse
from drivers.base.types import Array, Image, frozen
from drivers.base.yaml_text import dump_yaml

CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
MINIMUM_VIEWS = 3
FOCAL = 0.1, 100.0  # of the image's longer side: from a fisheye to a telescope
DISTORTION = 100.0  # largest coefficient
LARGEST_SIDE = 20_000  # px of a side


@dataclass(frozen=True, slots=True)
class Lens:
    """Lens model: camera `matrix` (3, 3) [px] and `distortion` k1 k2 p1 p2 k3 (5,).

    It is valid for images of `width` and `height` [px].
    """

    width: int
    height: int
    matrix: Array
    distortion: Array

    @classmethod
    def pinhole(
        cls,
        size: tuple[int, int],
        focal: float,
        centre: ArrayLike,
        distortion: Sequence[float] = (),
    ) -> Self:
        """Lens of square pixels for images of `size` (width, height) [px].

        `focal` is its focal length and `centre` (2,) its principal point [px];
        coefficients of the `distortion` that are not given are 0.
        """
        matrix = np.diag([focal, focal, 1.0])
        matrix[:2, 2] = centre
        coefficients = np.zeros(5)
        coefficients[: len(distortion)] = distortion
        width, height = size
        return cls(width, height, frozen(matrix), frozen(coefficients))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px] of its images."""
        return self.width, self.height

    def fits(self, image: Image) -> bool:
        """Whether `image` (h, w, 3) has the size for which the lens is valid."""
        return image.shape[:2] == (self.height, self.width)

    def undistort(self, pixels: Array) -> Array:
        """Ideal pinhole points (n, 2) [px] of image points `pixels` (n, 2)."""
        points = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if len(points) == 0:
            return points.reshape(0, 2)
        ideal = cv2.undistortImagePoints(
            points, self.matrix, self.distortion, arg1=CRITERIA
        )
        return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)

    def distort(self, pixels: Array) -> Array:
        """Image points (n, 2) [px] of ideal pinhole points `pixels` (n, 2)."""
        points = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        if len(points) == 0:
            return points
        rays = np.linalg.solve(
            self.matrix, np.column_stack([points, np.ones(len(points))]).T
        ).T
        image, _ = cv2.projectPoints(
            rays, np.zeros(3), np.zeros(3), self.matrix, self.distortion
        )
        return np.asarray(image, dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True, slots=True)
class LensFit:
    """Fitted lens with its rms error [px], the rms error of each view (n,) [px], and
    one sigma of its focal length [px].
    """

    lens: Lens
    rms: float
    per_view: Array
    focal_deviation: float


def fit_lens(
    object_points: Sequence[Array],
    image_points: Sequence[Array],
    size: tuple[int, int],
    fixed: int = cv2.CALIB_FIX_K3,
) -> LensFit:
    """Fit a lens to board corners, per view (m, 3) [m] on the board and (m, 2) [px] in
    the image.

    `size` is (width, height) [px], `fixed` are OpenCV's flags of what is not fitted.
    Raises ConfigurationError for fewer than three views, or corners outside of an image
    of that size.
    """
    if len(object_points) < MINIMUM_VIEWS:
        raise ConfigurationError(
            f"lens: {len(object_points)} board views, at least {MINIMUM_VIEWS} are"
            " needed; add more"
        )
    _check_inside(np.vstack(list(image_points)), size)
    rms, matrix, distortion, _, _, deviations, _, per_view = (
        cv2.calibrateCameraExtended(
            [np.float32(p).reshape(-1, 1, 3) for p in object_points],
            [np.float32(p).reshape(-1, 1, 2) for p in image_points],
            size,
            None,
            None,
            flags=fixed,
        )
    )
    lens = Lens(
        width=size[0],
        height=size[1],
        matrix=frozen(matrix),
        distortion=frozen(np.ravel(distortion)[:5]),
    )
    return LensFit(
        lens=lens,
        rms=float(rms),
        per_view=frozen(np.ravel(per_view)),
        focal_deviation=float(np.ravel(deviations)[0]),
    )


def _check_inside(points: Array, size: tuple[int, int]) -> None:
    """Raise ConfigurationError for `points` (n, 2) [px] outside of an image of `size`
    [px].
    """
    width, height = size
    u, v = points.max(axis=0)
    if u > width or v > height:
        raise ConfigurationError(
            f"lens: a corner at u {u:.0f}, v {v:.0f} px lies outside of an image of "
            f"{width} x {height} px; state its width first, then its height"
        )


def _checked_lens(lens: Lens, origin: str) -> Lens:
    """Return `lens` if it is plausible; raises ConfigurationError, naming `origin`,
    otherwise.

    Focal lengths must be finite and of the order of the image, its centre near the
    image, the distortion finite and bounded.
    """
    sides = np.array(lens.size)
    focal = np.diag(lens.matrix)[:2]
    centre = lens.matrix[:2, 2]
    low, high = np.multiply(FOCAL, sides.max())
    size = f"{lens.width} x {lens.height} px"
    beyond = ~(np.abs(lens.distortion) <= DISTORTION)
    square_pixels = np.array(
        [[focal[0], 0.0, centre[0]], [0.0, focal[1], centre[1]], [0, 0, 1.0]]
    )

    faults = (  # negated, so that NaN is refused too
        (
            sides.max() > LARGEST_SIDE,
            f"image_width, image_height: are {size}, at most {LARGEST_SIDE}",
        ),
        (
            not ((focal >= low) & (focal <= high)).all(),
            (
                f"camera_matrix: focal lengths are {focal[0]:g} and {focal[1]:g} px,"
                f" allowed {low:.0f} to {high:.0f} px for this image"
            ),
        ),
        (
            not ((centre >= -sides) & (centre <= 2.0 * sides)).all(),
            (
                f"camera_matrix: the centre is u {centre[0]:g}, v {centre[1]:g} px, far"
                f" outside of an image of {size}"
            ),
        ),
        (
            not np.array_equal(lens.matrix, square_pixels),
            "camera_matrix: has no skew and 0, 0, 1 in its last row",
        ),
        (
            beyond.any(),
            (
                f"distortion_coefficients: hold {lens.distortion[np.argmax(beyond)]:g},"
                f" allowed -{DISTORTION:g} to {DISTORTION:g}"
            ),
        ),
    )
    for wrong, text in faults:
        if wrong:
            raise ConfigurationError(f"{origin}: {text}; calibrate the camera again")

    return lens


class MatrixFile(Settings):
    """Matrix in the file format of ROS: shape, and values row by row."""

    rows: PositiveInt
    cols: PositiveInt
    data: tuple[float, ...]

    @classmethod
    def from_array(cls, matrix: Array) -> Self:
        """File content of a matrix (rows, cols) in ROS format."""
        rows, cols = matrix.shape
        return cls(rows=rows, cols=cols, data=tuple(matrix.ravel().tolist()))

    def array(self, shape: tuple[int, int], origin: str) -> Array:
        """Matrix of a ROS file as an array of `shape`; ConfigurationError for another
        shape.
        """
        if (self.rows, self.cols) != shape or len(self.data) != shape[0] * shape[1]:
            raise ConfigurationError(
                f"{origin}: must be {shape[0]} x {shape[1]} numbers"
            )
        return frozen(np.reshape(self.data, shape))


class CameraFile(Settings):
    """Content of a ROS camera_info file, the calibration format of image_pipeline."""

    image_width: PositiveInt
    image_height: PositiveInt
    camera_name: str
    camera_matrix: MatrixFile
    distortion_model: Literal["plumb_bob"] = "plumb_bob"
    distortion_coefficients: MatrixFile
    rectification_matrix: MatrixFile
    projection_matrix: MatrixFile

    @classmethod
    def from_lens(cls, lens: Lens, name: str) -> Self:
        """Content of a ROS camera_info file for `lens` of the camera `name`."""
        projection = np.column_stack([lens.matrix, np.zeros(3)])
        return cls(
            image_width=lens.width,
            image_height=lens.height,
            camera_name=name,
            camera_matrix=MatrixFile.from_array(lens.matrix),
            distortion_coefficients=MatrixFile.from_array(lens.distortion[None]),
            rectification_matrix=MatrixFile.from_array(np.eye(3)),
            projection_matrix=MatrixFile.from_array(projection),
        )

    def lens(self, origin: str) -> Lens:
        """Lens in a camera_info file; ConfigurationError for wrong shapes, implausible
        numbers.
        """
        matrix = self.camera_matrix.array((3, 3), f"{origin}: camera_matrix")
        distortion = self.distortion_coefficients.array(
            (1, 5), f"{origin}: distortion_coefficients"
        )
        lens = Lens(
            width=self.image_width,
            height=self.image_height,
            matrix=matrix,
            distortion=frozen(distortion.ravel()),
        )
        return _checked_lens(lens, origin)


# a tag of OpenCV's files, which no other reader of YAML knows
OPENCV = "!!opencv-matrix"
COEFFICIENTS = (4, 5)  # plumb bob, without and with k3
# keys of OpenCV's files that give the coefficients another meaning, and values that do
# not
MODEL_KEYS = {
    "fisheye_model": 0,
    "distortion_model": "plumb_bob",
    "camera_model": "pinhole",
    "xi": 0,
}


class OpenCvFile(Settings):
    """Content of a lens file that OpenCV's programs write, but for what else is in
    it.
    """

    image_width: PositiveInt
    image_height: PositiveInt
    camera_matrix: MatrixFile
    distortion_coefficients: MatrixFile

    def lens(self, origin: str) -> Lens:
        """Lens in a file of OpenCV; ConfigurationError for wrong shapes, implausible
        numbers.
        """
        matrix = self.camera_matrix.array((3, 3), f"{origin}: camera_matrix")
        distortion = self.distortion_coefficients.data
        if len(distortion) not in COEFFICIENTS:
            raise ConfigurationError(
                f"{origin}: distortion_coefficients: are {len(distortion)} numbers,"
                " allowed are 4 or 5 (plumb bob); calibrate with this model"
            )
        coefficients = frozen([*distortion, 0.0][:5])
        lens = Lens(
            width=self.image_width,
            height=self.image_height,
            matrix=matrix,
            distortion=coefficients,
        )
        return _checked_lens(lens, origin)


def write_camera_info(lens: Lens, name: str, path: Path) -> None:
    """Write `lens` of the camera `name` to `path` as a ROS camera_info file;
    ConfigurationError where that fails.
    """
    write_file(
        path, dump_yaml(CameraFile.from_lens(lens, name).model_dump(mode="json"))
    )


def write_opencv(lens: Lens, path: Path) -> None:
    """Write `lens` to `path` in the format of cv2.FileStorage; ConfigurationError where
    that fails.
    """
    kind = (
        cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
    )
    store = cv2.FileStorage("", kind)
    store.write("image_width", lens.width)
    store.write("image_height", lens.height)
    store.write("camera_matrix", np.array(lens.matrix))
    store.write("distortion_coefficients", np.array(lens.distortion)[None])
    write_file(path, store.releaseAndGetString())


def read_lens(path: Path) -> Lens:
    """Read the lens in a ROS or OpenCV file at `path`, by the tag of its matrices.

    Raises ConfigurationError for a missing or broken file, or another model than plumb
    bob.
    """
    text = read_text(path)
    if OPENCV in text:
        return _read_opencv(path, text)
    return load(path, CameraFile).lens(str(path))


def _read_opencv(path: Path, text: str) -> Lens:
    """Lens in an OpenCV file's `text`; ConfigurationError where it cannot be read."""
    try:
        store = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        names = (*OpenCvFile.model_fields, *MODEL_KEYS)
        nodes = {name: store.getNode(name) for name in names}
        content = {k: _value(node) for k, node in nodes.items() if not node.empty()}
        store.release()
    # OpenCV's parser raises the one inside of the other
    except (cv2.error, SystemError):
        raise ConfigurationError(
            f"{path}: cannot be read as a file of OpenCV; write it with cv2.FileStorage"
        ) from None

    for key, allowed in MODEL_KEYS.items():
        value = content.pop(key, allowed)
        if value != allowed:
            raise ConfigurationError(
                f"{path}: {key}: is {value}, another model than plumb bob (k1 k2 p1 p2"
                " k3), which alone is read; calibrate with this model"
            )
    return parse(content, OpenCvFile, str(path)).lens(str(path))


def _value(node: cv2.FileNode) -> object:
    """Value of a file's `node`: text, number, or matrix as in a ROS file."""
    if node.isMap():
        return MatrixFile.from_array(np.atleast_2d(node.mat())).model_dump()
    if node.isString():
        return node.string()
    return int(node.real()) if node.isInt() else node.real()
