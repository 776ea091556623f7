"""Three touched points, and the mounting that they give."""

from pathlib import Path

import numpy as np
import pytest

from cell.arm.register import mounting_from, write_mounting
from cell.config.places import CHECKOUT_CONFIGS, Configs
from drivers.errors import CellError
from drivers.installation import Mounting

TRUE = Mounting(x=0.41, y=-0.28, z=0.07, yaw=1.52)


def touched(length: float = 0.6, tilt: float = 0.0) -> np.ndarray:
    """The points that a desk at TRUE shows in the robot's base."""
    in_cell = np.array([[0, 0, 0, 1], [length, 0, 0, 1], [0.3, 0.2, 0.2 * tilt, 1]])
    return (TRUE.transform().matrix @ in_cell.T).T[:, :3]


def test_touched_points_give_the_mounting_back() -> None:
    found = mounting_from(touched(), 0.6)
    for name in ("x", "y", "z", "yaw"):
        assert getattr(found, name) == pytest.approx(getattr(TRUE, name), abs=1e-5)


@pytest.mark.parametrize(
    ("points", "word"),
    [
        (touched(length=0.59), "apart"),
        (touched(tilt=0.05), "tilted"),
        (touched()[[0, 1, 1]], "too near"),
    ],
)
def test_points_that_cannot_be_right_are_refused(points, word) -> None:
    with pytest.raises(CellError, match=word):
        mounting_from(points, 0.6)


def test_new_mounting_stands_in_the_file_and_the_old_one_beside_it(tmp_path: Path) -> None:
    text = (CHECKOUT_CONFIGS / "cell.yaml").read_text()
    (tmp_path / "cell.yaml").write_text(text)
    old = Configs(tmp_path).cell().installation.mounting
    path = write_mounting(Configs(tmp_path), TRUE)
    assert Configs(tmp_path).cell().installation.mounting == TRUE
    lines = path.read_text().splitlines()
    (kept,) = [line for line in lines if "# until" in line]
    assert f"x: {old.x}" in kept
    assert len(lines) == len(text.splitlines()) + 1
