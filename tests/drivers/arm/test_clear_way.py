"""The way home meets nothing: straight where it may, else around, else it is refused."""

from itertools import pairwise

import numpy as np
import pytest

from cell.arm.by_hand import PARKED, home_joints
from cell.config.places import find_configs
from drivers.arm.clear_way import (
    ARM_CLEARANCE,
    UPRIGHT,
    _joints_above,
    _keeps_clear,
    clear_way,
    solids_of,
)
from drivers.arm.failure import Failed
from drivers.franka.body import Box, Solids, apart
from drivers.franka.kinematics import forward
from tests.drivers.arm.test_loop import INSTALLATION

SOLIDS = solids_of(INSTALLATION)
UP = np.array([0.0, 0.0, 1.0])
HOME = np.array(home_joints(find_configs(None).cell(), find_configs(None).strip("denim")))


def nearest(points: list[np.ndarray], solids: Solids = SOLIDS) -> float:
    """The smallest distance [m] from anything along straight ways between `points`."""
    ways = [np.linspace(a, b, 200) for a, b in pairwise(points)]
    whole = np.concatenate(ways)
    return float(min(apart(whole).min(), solids.clearance(whole).min()))


def test_straight_way_is_taken_where_it_is_free() -> None:
    assert np.array_equal(PARKED, UPRIGHT)
    (way,) = clear_way(np.array(PARKED), HOME, SOLIDS)
    assert np.array_equal(way, HOME)
    assert nearest([np.array(PARKED), HOME]) > ARM_CLEARANCE


def wall() -> Solids:
    """What stands on the straight way from the parked posture to home, no higher than needed."""
    middle = forward((np.array(PARKED) + HOME) / 2)[:3, 3]
    low, high = middle - 0.04, middle + 0.04
    post = Box("post", (low[0], low[1], low[2] - 0.3), tuple(high))
    return Solids(np.eye(4), (post,))


def test_blocked_way_is_gone_around() -> None:
    start = np.array(PARKED)
    assert nearest([start, HOME], wall()) < 0
    way = clear_way(start, HOME, wall())
    assert len(way) > 1
    assert np.array_equal(way[-1], HOME)
    assert nearest([start, *way], wall()) > ARM_CLEARANCE - 0.002


def test_way_that_nothing_leads_around_is_refused_with_what_is_met() -> None:
    fence = Solids(np.eye(4), (Box("fence", (-2, 0.1, -1), (2, 0.14, 2)),))
    crossed = HOME + np.array([2 * -HOME[0], 0, 0, 0, 0, 0, 0])
    with pytest.raises(Failed, match="from the fence") as refused:
        clear_way(crossed, HOME, fence)
    assert refused.value.failure.cause == "arm_way_blocked"


def test_arm_that_begins_too_near_may_leave_but_not_dive() -> None:
    assert _keeps_clear(np.array([0.01, 0.02, 0.03, 0.05]))
    assert _keeps_clear(np.array([-0.01, 0.02, 0.05, 0.03, 0.01]))
    assert not _keeps_clear(np.array([0.02, 0.01, 0.05]))
    assert not _keeps_clear(np.array([0.05, 0.02, 0.05]))
    assert not _keeps_clear(np.array([0.05, 0.01, 0.02]))
    assert not _keeps_clear(np.array([0.01, 0.02]))


def test_points_above_are_straight_above() -> None:
    places = np.array([forward(q)[:3, 3] for q in (HOME, *_joints_above(HOME, UP, 0.1))])
    assert places[-1] - places[0] == pytest.approx([0, 0, 0.1], abs=1e-3)
    assert len(places) == 3
