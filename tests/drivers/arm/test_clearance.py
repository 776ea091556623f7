"""The body of the hand and the desk."""

import numpy as np
import pytest

from drivers.arm.clear_way import solids_of
from drivers.arm.clearance import desk_clearance, desk_end, require_clear
from drivers.errors import Fault
from drivers.installation import Installation
from drivers.types import Pose

HOME = Pose(0.6, 0.15, 0.0)


def test_hand_that_points_down_stands_clear_of_the_desk() -> None:
    assert desk_clearance(np.array([[0.3, 0.0, np.pi / 2]]), 0.6)[0] > 0.03


def test_hand_that_lies_flat_over_the_desk_would_run_into_it() -> None:
    assert desk_clearance(np.array([[0.3, 0.0, 0.0]]), 0.6)[0] < 0


def test_hand_that_lies_flat_beside_the_desk_is_free() -> None:
    poses = np.array([[0.6, 0.0, 0.0], [0.0, 0.0, np.pi]])
    assert np.isinf(desk_clearance(poses, 0.6)).all()


@pytest.mark.parametrize(
    ("stated", "length", "end"),
    [(None, None, 0.85), (None, 0.6, 0.6), (0.7, None, 0.7), (0.7, 0.6, 0.7), (0.5, 0.6, 0.6)],
)
def test_desk_ends_where_the_cell_says_else_with_workspace_or_strip(stated, length, end) -> None:
    installation = Installation(desk=stated)
    assert desk_end(installation, length) == end
    if length is None:
        assert solids_of(installation).boxes[0].high[0] == end


def test_hand_is_not_driven_into_the_desk() -> None:
    with pytest.raises(Fault, match="22 mm into the desk at x 500, z 10 mm") as fault:
        require_clear([HOME, Pose(0.5, 0.01, 0.0)], 0.6)
    assert fault.value.name == "hand_meets_desk"
    require_clear([HOME, Pose(0.5, 0.06, 0.0)], 0.6)


def test_way_between_two_clear_poses_may_not_lead_through_the_desk() -> None:
    with pytest.raises(Fault, match="into the desk"):
        require_clear([Pose(0.65, 0.0, 0.0), Pose(-0.3, 0.0, 0.0)], 0.6)


def test_hand_that_begins_inside_the_desk_may_leave_it_and_go_no_deeper() -> None:
    inside = Pose(0.5, 0.01, 0.0)
    require_clear([inside, Pose(0.5, 0.02, 0.0)], 0.6)
    with pytest.raises(Fault, match="into the desk"):
        require_clear([inside, Pose(0.5, 0.005, 0.0)], 0.6)
