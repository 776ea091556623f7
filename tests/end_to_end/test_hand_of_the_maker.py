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
from tests.support.franky_sim import franky_sim_model
from tests.support.maker_scene import PIECES, MakerScene
from tests.support.planned_moments import OPEN, Plan, plan
from tests.support.seen_folds import STRIPS

pytestmark = pytest.mark.slow

NAMES = sorted(path.stem for path in STRIPS.glob("*.yaml"))
POSTURE_STEP = 0.02  # rad of a joint between postures that are looked at


def scene_of(planned: Plan) -> MakerScene:
    solids = solids_of(planned.installation)
    return MakerScene(franky_sim_model(), solids, planned.strip)


@pytest.fixture(scope="module")
def denim(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return plan("denim", tmp_path_factory.mktemp("runs"))


@pytest.mark.parametrize("name", NAMES)
def test_pads_pinch_the_strip_at_every_tick_and_nothing_else_touches(
    name: str, tmp_path: Path
) -> None:
    planned = plan(name, tmp_path)
    scene = scene_of(planned)
    held = 0
    for moment in planned.fold():
        scene.place(moment.joints, moment.width, moment.midline)
        where = moment.pose.round(3).tolist()
        assert list(scene.touching()) == [], where
        if moment.held:
            held += 1
            assert scene.grip_objection(moment.pose) == "", where
    assert held > 1000


def touched(scene: MakerScene, postures: Iterator[Array], midline: Array) -> list[str]:
    """What touches at any of the `postures` of an open hand beside a strip."""
    found = list[str]()
    for joints in postures:
        scene.place(joints, OPEN, midline)
        found += scene.touching()
    return found


def lying(planned: Plan) -> Array:
    """The flat strip's midline (n, 2) [m]."""
    along = np.linspace(0.0, planned.strip.length, PIECES + 1)
    return np.column_stack([along, np.zeros_like(along)])


def way(start: Array, goal: Array, solids: Solids) -> Iterator[Array]:
    """Postures (7,) [rad] on the way that the driver takes between two."""
    for before, after in pairwise([start, *clear_path(start, goal, solids)]):
        count = 2 + int(np.abs(after - before).max() / POSTURE_STEP)
        yield from np.linspace(before, after, count)


def test_nothing_touches_on_the_joints_ways_home_and_to_park(denim: Plan) -> None:
    solids = solids_of(denim.installation)
    *_, (_, _, retreated) = denim.timed(denim.path, denim.speeds)
    home = denim.reach.start
    for start, goal in ((HOME, home), (retreated, home), (retreated, HOME)):
        assert touched(scene_of(denim), way(start, goal, solids), lying(denim)) == []
