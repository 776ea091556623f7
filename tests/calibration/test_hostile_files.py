"""A lens, a session or a picture as nobody should write it is refused in one line, and
at once.
"""

import os
import struct
from base64 import b64encode
from contextlib import suppress
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np
import pytest

from calibration.lens import read_lens
from calibration.view import Landmarks
from calibration.wizard.session import read_rows, read_steps
from drivers.base.errors import ConfigurationError
from drivers.base.readers import picture_sides, read_picture

SPOILT = {
    "nul": b"\x00" * 40,
    "not utf-8": b"\xff\xfe\x00",
    "deep": b"[" * 100_000,
    "empty": b"",
    "opencv": b"%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n",
}


@pytest.fixture(params=[*SPOILT, "pipe", "endless"])
def spoilt(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A file that nobody can use, under every name that a reader asks for."""
    param = request.param
    for name in ("told.jsonl", "latency.json", "lens.yaml"):
        if param == "pipe":
            os.mkfifo(tmp_path / name)
        elif param == "endless":
            (tmp_path / name).symlink_to("/dev/zero")
        else:
            (tmp_path / name).write_bytes(SPOILT[param])
    return tmp_path


def test_spoilt_files_are_refused_in_one_line_or_hold_nothing(spoilt: Path) -> None:
    with pytest.raises(ConfigurationError) as lens:
        read_lens(spoilt / "lens.yaml")
    with pytest.raises(ConfigurationError) as latency:
        read_steps(spoilt)
    assert "\n" not in f"{lens.value}{latency.value}"
    # a truncated last line is no row, the rest is refused
    with suppress(ConfigurationError):
        assert list(read_rows(spoilt)) == []


def test_picture_of_sixty_thousand_pixels_is_refused_before_it_is_decoded(
    tmp_path: Path,
) -> None:
    head = struct.pack(">4sII5B", b"IHDR", 60_000, 60_000, 8, 2, 0, 0, 0)
    png = (
        b"\x89PNG\r\n\x1a\n"
        + struct.pack(">I", 13)
        + head
        + struct.pack(">I", crc32(head))
    )
    (tmp_path / "p.png").write_bytes(png + struct.pack(">I4s40x", 40, b"IDAT"))
    with pytest.raises(ConfigurationError, match="60000 x 60000 px"):
        read_picture(tmp_path / "p.png")


def test_chunk_of_gigabytes_is_refused_before_memory_is_set_aside(
    tmp_path: Path,
) -> None:
    whole = cv2.imencode(".png", np.zeros((4, 144, 3), np.uint8))[1].tobytes()
    at = whole.index(b"IDAT") - 4
    content = whole[:at] + b"\x93" + whole[at + 1 :]  # 2.5 GB, by one byte
    (tmp_path / "p.png").write_bytes(content)
    assert (picture_sides(whole), picture_sides(content)) == ((144, 4), (0, 0))
    with pytest.raises(ConfigurationError, match="not a picture"):
        read_picture(tmp_path / "p.png")
    jpeg = b64encode(content).decode("ascii")
    with pytest.raises(ConfigurationError, match="landmarks: jpeg: is not a picture"):
        Landmarks(x=0, z=0, pitch=0, jpeg=jpeg).picture()
