"""Files that hold a lens: the camera_info YAML of ROS, and OpenCV's own YAML."""

from pathlib import Path

import cv2
import numpy as np
import yaml

from calibration.lens import CameraFile, Lens
from drivers.errors import ConfigurationError
from drivers.settings import load
from drivers.types import Array, frozen

OPENCV = "!!opencv-matrix"  # a tag of OpenCV's files, which no other reader of YAML knows
NODES = ("image_width", "image_height", "camera_matrix", "distortion_coefficients")
COEFFICIENTS = (4, 5)  # plumb bob, without and with k3


def write_camera_info(lens: Lens, name: str, path: Path) -> None:
    """Write `lens` of the camera `name` as ROS camera_info; ConfigurationError where it cannot."""
    content = yaml.safe_dump(CameraFile.of(lens, name).content(), sort_keys=False)
    try:
        path.write_text(content, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None


def write_opencv(lens: Lens, path: Path) -> None:
    """Write `lens` as cv2.FileStorage does; ConfigurationError where it cannot be written."""
    if not path.parent.is_dir():
        raise ConfigurationError(f"{path}: cannot be written: there is no such folder")
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_FORMAT_YAML)
    try:
        store.write("image_width", lens.width)
        store.write("image_height", lens.height)
        store.write("camera_matrix", np.array(lens.matrix))
        store.write("distortion_coefficients", np.array(lens.distortion)[None])
    finally:
        store.release()


def read_lens(path: Path) -> Lens:
    """The lens in a ROS or OpenCV file, distinguished by the tag of its matrices.

    A missing or broken file, or another model than plumb bob, is a ConfigurationError.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    if OPENCV in text:
        return _read_opencv(path)
    return load(path, CameraFile).lens(str(path))


def _read_opencv(path: Path) -> Lens:
    try:
        store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        missing = [name for name in NODES if store.getNode(name).empty()]
        if missing:
            raise ConfigurationError(f"{path}: {missing[0]}: is missing; add it")
        width, height = (int(store.getNode(name).real()) for name in NODES[:2])
        matrix, distortion = (np.array(store.getNode(name).mat()) for name in NODES[2:])
        store.release()
    except (cv2.error, SystemError):  # OpenCV's parser raises the one inside of the other
        raise ConfigurationError(
            f"{path}: cannot be read as a file of OpenCV; write it with cv2.FileStorage"
        ) from None
    return _checked(path, (width, height), matrix.astype(np.float64), distortion.ravel())


def _checked(path: Path, size: tuple[int, int], matrix: Array, distortion: Array) -> Lens:
    if matrix.shape != (3, 3):
        raise ConfigurationError(f"{path}: camera_matrix: must be 3 x 3 numbers")
    if len(distortion) not in COEFFICIENTS:
        raise ConfigurationError(
            f"{path}: distortion_coefficients: are {len(distortion)} numbers, allowed are 4 or 5 "
            "(plumb bob); calibrate with this model"
        )
    if min(size) <= 0:
        raise ConfigurationError(f"{path}: image_width, image_height: must be positive")
    return Lens(*size, frozen(matrix), frozen([*distortion, 0.0][:5]))
