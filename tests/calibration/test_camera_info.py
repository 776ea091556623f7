"""A lens and its files: ROS's and OpenCV's are written and read; broken ones refused in
a line.
"""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from calibration.lens import Lens, read_lens, write_camera_info, write_opencv
from drivers.base.errors import ConfigurationError

LENS = Lens.pinhole((1280, 720), 3400.0, (645.0, 355.0), (-0.18, 0.1, 0.001, -0.002))
MATRIX = LENS.matrix
OFF_CENTRE = np.array([[0.0, 0, 0], [0, 0, 5000.0], [0, 0, 0]])


def _same(lens: Lens) -> bool:
    return (
        np.array_equal(lens.matrix, LENS.matrix)
        and np.array_equal(lens.distortion, LENS.distortion)
        and (lens.width, lens.height) == (1280, 720)
    )


def test_undistort_and_distort_are_inverse_over_the_whole_image() -> None:
    rng = np.random.default_rng(0)
    pixels = rng.uniform((0, 0), (1280, 720), (200, 2))
    assert np.abs(LENS.distort(LENS.undistort(pixels)) - pixels).max() < 1e-6
    assert np.abs(LENS.undistort(pixels) - pixels).max() > 1.0


def test_camera_info_round_trip_keeps_every_digit(tmp_path: Path) -> None:
    write_camera_info(LENS, "twin", tmp_path / "camera.yaml")
    assert _same(read_lens(tmp_path / "camera.yaml"))
    content = yaml.safe_load((tmp_path / "camera.yaml").read_text())
    assert [*content] == [
        "image_width",
        "image_height",
        "camera_name",
        "camera_matrix",
        "distortion_model",
        "distortion_coefficients",
        "rectification_matrix",
        "projection_matrix",
    ]


def test_opencv_round_trip_keeps_every_digit(tmp_path: Path) -> None:
    write_opencv(LENS, tmp_path / "camera.yaml")
    assert _same(read_lens(tmp_path / "camera.yaml"))
    with pytest.raises(yaml.YAMLError):
        yaml.safe_load((tmp_path / "camera.yaml").read_text())


@pytest.mark.parametrize("header", ["%YAML:1.0\n---", "%YAML 1.2\n---"])
def test_old_and_new_headers_of_opencv_are_read(tmp_path: Path, header: str) -> None:
    path = tmp_path / "camera.yaml"
    write_opencv(LENS, path)
    path.write_text(header + path.read_text().partition("---")[2])
    assert _same(read_lens(path))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("fisheye_model", 1, "fisheye_model: is 1, another model than plumb bob"),
        ("xi", 1.2, "xi: is 1.2, another model"),
        ("xi", np.array([[1.2]]), "xi: is .*1.2.*, another model"),
        ("distortion_model", "equidistant", "distortion_model: is equidistant"),
        (
            "distortion_coefficients",
            np.zeros((1, 8)),
            "are 8 numbers, allowed are 4 or 5",
        ),
        ("image_width", 0, "image_width: is 0, must be more than 0"),
        ("image_height", 640.7, "image_height: input should be a valid integer"),
        ("image_width", np.inf, "image_width: input should be a"),
        ("camera_matrix", np.array(MATRIX) + np.eye(3, k=1), "has no skew"),
        ("camera_matrix", np.eye(2), "camera_matrix: must be 3 x 3 numbers"),
        ("camera_matrix", np.diag([40.0, 40.0, 1.0]), "focal lengths are 40 and 40 px"),
        (
            "camera_matrix",
            np.array(MATRIX) + OFF_CENTRE,
            "the centre is u 645, v 5355 px",
        ),
        ("fisheye_model", 0, None),
        ("distortion_model", "plumb_bob", None),
    ],
)
def test_opencv_file_of_another_lens_model_is_refused_by_its_name(
    tmp_path: Path, key: str, value: object, message: str | None
) -> None:
    path = tmp_path / "camera.yaml"
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    stated = {
        "image_width": 1280,
        "image_height": 720,
        "camera_matrix": np.array(MATRIX),
    }
    stated |= {"distortion_coefficients": np.zeros((1, 4)), key: value}
    for name, content in stated.items():
        store.write(name, content)
    store.release()
    if message is None:
        assert not read_lens(path).distortion.any()
        return
    with pytest.raises(ConfigurationError, match=message):
        read_lens(path)


def test_garbage_and_missing_files_are_one_clear_line(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text("%YAML:1.0\n{{{: !!opencv-matrix garbage\n")
    with pytest.raises(ConfigurationError, match="cannot be read as a file of OpenCV"):
        read_lens(path)
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_lens(tmp_path / "none.yaml")
