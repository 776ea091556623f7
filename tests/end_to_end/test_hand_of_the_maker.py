"""Folds and ways of the arm in the maker's model of arm and hand: the pads pinch the
strip's edge where it is held, and nothing else touches.
"""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from drivers.base.types import Array
from drivers.franka.collision import Solids
from drivers.franka.kinematics import HOME
from drivers.franka.obstacles import clear_path, solids_of
from tests.support.fold_moments import Plan, beside, plan, scene_for
from tests.support.seen_folds import STRIPS

pytestmark = pytest.mark.slow

NAMES = sorted(path.stem for path in STRIPS.glob("*.yaml"))
POSTURE_STEP = 0.02  # rad of a joint between postures that are looked at


@pytest.fixture(scope="module")
def denim(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return plan("denim", tmp_path_factory.mktemp("runs"))


@pytest.mark.parametrize("name", NAMES)
def test_pads_pinch_the_strip_at_every_tick_and_nothing_else_touches(
    name: str, tmp_path: Path
) -> None:
    planned = plan(name, tmp_path)
    scene = scene_for(planned.installation, planned.strip)
    held, wrong = scene.judge(planned.fold())
    assert wrong == []
    assert held > 1000


def way(start: Array, goal: Array, solids: Solids) -> Iterator[Array]:
    """Postures (7,) [rad] on the way that the driver takes between two."""
    for before, after in pairwise([start, *clear_path(start, goal, solids)]):
        count = 2 + int(np.abs(after - before).max() / POSTURE_STEP)
        yield from np.linspace(before, after, count)


def test_nothing_touches_on_the_joints_ways_home_and_to_park(denim: Plan) -> None:
    solids = solids_of(denim.installation)
    *_, (_, _, retreated) = denim.timed(denim.path, denim.speeds)
    home = denim.reach.start
    scene = scene_for(denim.installation, denim.strip)
    for start, goal in ((HOME, home), (retreated, home), (retreated, HOME)):
        postures = way(start, goal, solids)
        assert scene.judge(beside(postures, denim.strip)) == (0, [])
