"""The folds of ten strips in the maker's model of arm and hand, by the joints that the
driver commands: the pads pinch the strip's edge, and nothing else touches.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from cell.base.config.places import find_configs
from cell.base.devices.fold_path import LOOSE, whole_path
from cell.folding.feasibility import from_edge, simulate
from drivers.base.installation import Installation
from drivers.base.types import Array
from drivers.franka.inverse_kinematics import ELBOW_JOINT, track
from drivers.franka.obstacles import solids_of
from drivers.franka.plane import StripPlane
from drivers.franka.reach import Reach, densify, plan_reach
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.twin.chain.engine import Chain
from policies.registry import make_policy
from tests.support.franky_sim import franky_sim_model
from tests.support.maker_scene import PIECES, MakerScene
from tests.support.seen_folds import STRIPS

TICK = 0.005  # s
GRASPED, RELEASED = 4, -3  # points of a whole path
OPEN = 0.04  # m between open fingers
LEAVING = 0.35  # s until the hand has left the edge, which rests on its lower pad
NAMES = sorted(path.stem for path in STRIPS.glob("*.yaml"))


@dataclass(frozen=True, slots=True)
class Moment:
    """Gripper pose x, z [m], pitch [rad], the arm's joints (7,) [rad], `width` [m]
    between the fingers, the strip's midline (n, 2) [m], and whether it is `held`.
    """

    pose: Array
    joints: Array
    width: float
    midline: Array
    held: bool


@dataclass(frozen=True, slots=True)
class Plan:
    """A fold of `strip` in an `installation` as planned: path, speeds, `reach`."""

    installation: Installation
    strip: StripFile
    path: Array
    speeds: Array
    reach: Reach

    def timed(self, path: Array, speeds: Array) -> Iterator[tuple[float, Array, Array]]:
        """Yield time [s], pose (3,) and joints (7,) [rad] at each tick along `path`."""
        poses, times = densify(path, speeds)
        due = np.cumsum(times) - times[0]
        plane = StripPlane(
            self.installation.mounting.transform(), turned=self.reach.turned
        )
        joints, elbow = self.reach.start, float(self.reach.start[ELBOW_JOINT])
        for time in np.arange(0.0, due[-1], TICK).tolist():
            pose = np.array([np.interp(time, due, column) for column in poses.T])
            tracked = track(joints, plane.matrix(*pose.tolist()), elbow, 12)
            assert tracked is not None
            joints = tracked[0]
            yield time, pose, joints

    def due(self, point: int) -> float:
        """Time [s] at which a `point` of the path is reached."""
        count = point % len(self.path) + 1
        return float(densify(self.path[:count], self.speeds[:count])[1][1:].sum())

    def fold(self) -> Iterator[Moment]:
        """Yield all moments of the fold, from home to the retreat."""
        grasped, released = self.due(GRASPED), self.due(RELEASED)
        chain = Chain(PIECES)
        chain.reset([describe(self.strip)])
        seen = resting = chain.shapes()[0].copy()
        thickness = self.strip.thickness
        for time, pose, joints in self.timed(self.path, self.speeds):
            held = grasped <= time < released
            if time >= grasped:
                if not held:
                    chain.release()
                chain.step(pose[None], TICK)
                seen = chain.shapes()[0].copy()
            if held:
                resting = seen
            lies = resting if released <= time < released + LEAVING else seen
            loose = OPEN if time < grasped else thickness + LOOSE
            yield Moment(pose, joints, thickness if held else loose, lies, held)


def plan(name: str) -> Plan:
    """The fold of the strip `name` as the cell plans it, by a policy that knows it."""
    configs = find_configs(None)
    settings, strip = configs.cell(), configs.strip(name)
    place = settings.fci.limit(settings.installation)
    place = place.model_copy(update={"desk": strip.length})
    policy = make_policy("planned", None, in_rod=True)
    folds = simulate(settings, strip, policy, 0)
    carry = from_edge(strip, folds.trace[:, 0])
    path, speeds = whole_path(strip.length, place, settings.fold, carry, folds.touch[0])
    return Plan(place, strip, path, speeds, plan_reach(place, path, speeds))


def thinned(midline: Array) -> Array:
    """Midline (PIECES + 1, 2) [m] through points of a finer one (n, 2)."""
    return midline[np.linspace(0, len(midline) - 1, PIECES + 1).round().astype(int)]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_pads_pinch_the_strip_at_every_tick_and_nothing_else_touches(
    name: str,
) -> None:
    model = franky_sim_model()
    planned = plan(name)
    assert planned.reach.allowed
    scene = MakerScene(model, solids_of(planned.installation), planned.strip)
    held = 0
    for moment in planned.fold():
        scene.place(moment.joints, moment.width, thinned(moment.midline))
        where = moment.pose.round(3).tolist()
        assert list(scene.touching()) == [], where
        if moment.held:
            held += 1
            assert scene.grip_objection(moment.pose) == "", where
    assert held > 1000
