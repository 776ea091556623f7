"""The lens wizard and the watch over a camera, through the kernel's virtual camera."""

import json
from pathlib import Path

import numpy as np
import pytest

from calibration.wizard.coverage import wanted_views
from cell.base.config.places import find_configs
from drivers.twin.board import board_frame, board_pose
from tests.drivers.v4l2.machine import beside_vivid

pytestmark = pytest.mark.long
LIMIT = 900.0  # s until the machine counts as hung; it needs 260 s of a processor


def board_views() -> np.ndarray:
    """Images (n, 720, 1280, 3) of a board, held as the wizard asks."""
    cell = find_configs(Path("configs")).cell()
    camera, boards = cell.twin.camera, cell.boards
    board = boards.board()
    return np.array(
        [
            board_frame(camera, board, board_pose(camera, board, view), 1, number).image
            for number, view in enumerate(wanted_views(boards.lean, boards.sizes))
        ]
    )


def test_lens_is_found_and_a_moved_camera_told(tmp_path: Path) -> None:
    np.save(tmp_path / "views.npy", board_views())
    module = "tests.drivers.v4l2.vivid.commands"
    words = (module, str(tmp_path / "views.npy"))
    lines = list(beside_vivid(tmp_path, *words, seconds=LIMIT))
    print(*lines, sep="\n")
    pinned, still, moved, lens = (json.loads(x) for x in lines if x.startswith("{"))
    assert (pinned["code"], still["code"], moved["code"]) == (0, 0, 1)
    assert "off by 0.0 px" in still["said"]
    assert "off by 2.0 px" in moved["said"]
    assert lens["code"] == 0
    assert "good: the lens may be used" in lens["said"]
