"""What a person named for results is written over only where the program wrote it."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from drivers.base.outputs import check_output_folder, sealed, write_output

PAGE = b"<!doctype html>\n<html>\n<head>\n<title>runs</title>\n</head>\n</html>\n"
PICTURE = cv2.imencode(".png", np.arange(48, dtype=np.uint8).reshape(4, 4, 3))[1]


@pytest.mark.parametrize("content", [PAGE, PICTURE.tobytes()], ids=["page", "picture"])
def test_what_the_program_wrote_is_written_over_and_what_changed_since_is_kept(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "out"
    write_output(path, content)
    write_output(path, content)
    assert path.read_bytes() == sealed(content) != content
    edited = path.read_bytes()[:-1] + b"\x01"
    path.write_bytes(edited)
    with pytest.raises(ConfigurationError, match="or was changed since; name another"):
        write_output(path, content)
    assert path.read_bytes() == edited


def test_sealed_picture_is_still_a_picture() -> None:
    decoded = cv2.imdecode(np.frombuffer(sealed(PICTURE.tobytes()), np.uint8), -1)
    assert decoded.ravel().tolist() == list(range(48))


@pytest.mark.parametrize("foreign", [b"", b"schema: 1\n", PAGE, PICTURE.tobytes()])
def test_what_another_program_wrote_is_kept(tmp_path: Path, foreign: bytes) -> None:
    path = tmp_path / "cell.yaml"
    path.write_bytes(foreign)
    with pytest.raises(ConfigurationError, match="was not written by this program"):
        write_output(path, PAGE)
    assert path.read_bytes() == foreign


def test_folder_for_results_is_new_empty_or_holds_a_mark(tmp_path: Path) -> None:
    check_output_folder(tmp_path / "new", "fit.json")
    check_output_folder(tmp_path, "fit.json")
    (tmp_path / "mine.txt").touch()
    for place in (tmp_path, tmp_path / "mine.txt"):
        with pytest.raises(ConfigurationError, match=r"fit\.json|Not a directory"):
            check_output_folder(place, "fit.json")
    (tmp_path / "fit.json").touch()
    check_output_folder(tmp_path, "check.json", "fit.json")
