"""The folds of ten strips in the maker's model of arm and hand, by the joints that the
driver commands: the pads pinch the strip's edge, and nothing else touches.
"""

from pathlib import Path

import pytest

from drivers.franka.obstacles import solids_of
from tests.support.franky_sim import franky_sim_model
from tests.support.maker_scene import MakerScene
from tests.support.planned_moments import plan
from tests.support.seen_folds import STRIPS

NAMES = sorted(path.stem for path in STRIPS.glob("*.yaml"))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_pads_pinch_the_strip_at_every_tick_and_nothing_else_touches(
    name: str, tmp_path: Path
) -> None:
    model = franky_sim_model()
    planned = plan(name, tmp_path)
    scene = MakerScene(model, solids_of(planned.installation), planned.strip)
    held = 0
    for moment in planned.fold():
        scene.place(moment.joints, moment.width, moment.midline)
        where = moment.pose.round(3).tolist()
        assert list(scene.touching()) == [], where
        if moment.held:
            held += 1
            assert scene.grip_objection(moment.pose) == "", where
    assert held > 1000
