"""Three touched points, and the mounting that they give."""

import numpy as np
import pytest

from cell.setup.arm.register import mounting_from_points
from drivers.base.errors import CellError
from drivers.base.installation import Mounting

TRUE = Mounting(x=0.41, y=-0.28, z=0.07, yaw=1.52)


def touched(length: float = 0.6, tilt: float = 0.0) -> np.ndarray:
    """The points that a desk at TRUE shows in the robot's base."""
    in_cell = np.array([[0, 0, 0, 1], [length, 0, 0, 1], [0.3, 0.2, 0.2 * tilt, 1]])
    return (TRUE.transform().matrix @ in_cell.T).T[:, :3]


def test_touched_points_give_the_mounting_back() -> None:
    found = mounting_from_points(touched(), 0.6)
    for name in ("x", "y", "z", "yaw"):
        assert getattr(found, name) == pytest.approx(getattr(TRUE, name), abs=1e-5)


@pytest.mark.parametrize(
    ("points", "word"),
    [
        (touched(length=0.59), "apart"),
        (touched(tilt=0.05), "tilted"),
        (touched()[[0, 1, 1]], "too near"),
        (np.nan * touched(), "apart"),
    ],
)
def test_points_that_cannot_be_right_are_refused(points, word) -> None:
    with pytest.raises(CellError, match=word):
        mounting_from_points(points, 0.6)
