"""Hand and arm meet nothing: desk, clamp, floor, the arm itself; ways lead around."""

from itertools import pairwise

import numpy as np
import pytest

from cell.base.config.places import find_configs
from cell.setup.arm.manual_motion import home_joints
from drivers.base.errors import Fault
from drivers.base.installation import Installation
from drivers.base.types import Pose
from drivers.franka.collision import Solids, self_clearance
from drivers.franka.failure import ArmFault
from drivers.franka.kinematics import HOME, forward
from drivers.franka.obstacles import (
    ARM_CLEARANCE,
    _keeps_clear,
    clear_path,
    desk_clearance,
    require_clear,
    solids_of,
)
from drivers.franka.shapes import TIP_AHEAD, BoxObstacle, desk_end
from tests.drivers.franka.rig import INSTALLATION

SOLIDS = solids_of(INSTALLATION)
ABOVE_EDGE = Pose(0.6, 0.15, 0.0)
START = np.array(
    home_joints(find_configs(None).cell(), find_configs(None).strip("denim"))
)


def nearest(points: list[np.ndarray], solids: Solids = SOLIDS) -> float:
    """The smallest distance [m] from anything along straight ways between `points`."""
    whole = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(points)])
    return float(min(self_clearance(whole).min(), solids.clearance(whole).min()))


def test_straight_way_is_taken_where_it_is_free() -> None:
    (way,) = clear_path(HOME, START, SOLIDS)
    assert np.array_equal(way, START)
    assert nearest([HOME, START]) > ARM_CLEARANCE


def wall() -> Solids:
    """What stands on the straight way from the parked posture to home, no higher than
    needed.
    """
    middle = forward((HOME + START) / 2)[:3, 3]
    post = BoxObstacle("post", tuple(middle - (0.04, 0.04, 0.34)), tuple(middle + 0.04))
    return Solids(np.eye(4), (post,))


def test_blocked_way_is_gone_around() -> None:
    assert nearest([HOME, START], wall()) < 0
    *detour, end = clear_path(HOME, START, wall())
    assert detour
    assert np.array_equal(end, START)
    assert nearest([HOME, *detour, end], wall()) > ARM_CLEARANCE - 0.002


def test_way_without_a_detour_is_refused_and_names_the_obstacle() -> None:
    fence = Solids(np.eye(4), (BoxObstacle("fence", (-2, 0.1, -1), (2, 0.14, 2)),))
    crossed = START + np.array([2 * -START[0], 0, 0, 0, 0, 0, 0])
    with pytest.raises(ArmFault, match="from the fence") as refused:
        clear_path(crossed, START, fence)
    assert refused.value.cause == "arm_way_blocked"


def test_arm_that_begins_too_near_may_leave_but_not_dive() -> None:
    assert _keeps_clear(np.array([-0.01, 0.02, 0.05, 0.03, 0.01]))
    assert not _keeps_clear(np.array([0.02, 0.01, 0.05]))
    assert not _keeps_clear(np.array([0.05, 0.02, 0.05]))
    assert not _keeps_clear(np.array([0.05, 0.01, 0.02]))
    assert not _keeps_clear(np.array([0.01, 0.02]))


def test_hand_is_clear_of_the_desk_where_it_points_down_or_lies_beside_it() -> None:
    poses = [
        [0.3, 0.01, np.pi / 2],
        [0.3, 0.1, 0.0],
        [0.6, 0.0, 0.0],
        [-0.03, 0, np.pi],
    ]
    down, flat, *beside = desk_clearance(np.array(poses), 0.6)
    assert flat < 0.0
    assert down == pytest.approx(0.01 - TIP_AHEAD)
    assert np.isinf(beside).all()


@pytest.mark.parametrize(
    ("stated", "length", "end"),
    [
        (None, None, 0.85),
        (None, 0.6, 0.6),
        (0.7, None, 0.7),
        (0.7, 0.6, 0.7),
        (0.5, 0.6, 0.6),
    ],
)
def test_desk_ends_where_the_cell_says_else_with_workspace_or_strip(
    stated, length, end
) -> None:
    installation = Installation(desk=stated)
    assert desk_end(installation, length) == end
    if length is None:
        assert solids_of(installation).boxes[1].high[0] == end


def test_hand_is_not_driven_into_the_desk() -> None:
    with pytest.raises(Fault, match="94 mm into the desk at x 500, z 10 mm") as fault:
        require_clear([ABOVE_EDGE, Pose(0.5, 0.01, 0.0)], 0.6)
    assert fault.value.name == "hand_meets_desk"
    require_clear([ABOVE_EDGE, Pose(0.5, 0.11, 0.0)], 0.6)
    with pytest.raises(Fault, match="into the desk"):  # between two clear poses
        require_clear([Pose(0.65, 0.0, 0.0), Pose(-0.3, 0.0, 0.0)], 0.6)


def test_hand_that_begins_inside_the_desk_may_leave_it_and_go_no_deeper() -> None:
    inside = Pose(0.5, 0.01, 0.0)
    require_clear([inside, Pose(0.5, 0.02, 0.0)], 0.6)
    with pytest.raises(Fault, match="into the desk"):
        require_clear([inside, Pose(0.5, 0.005, 0.0)], 0.6)
