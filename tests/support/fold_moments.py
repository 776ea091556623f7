"""Folds as the cell plans them and as a robot carried them out, moment by moment:
joints, fingers and the strip.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from cell.base.config.places import find_configs
from cell.base.devices.fold_path import LOOSE
from cell.folding.feasibility import assess
from cell.record.files import JOINTS
from drivers.base.installation import Installation
from drivers.base.types import Array
from drivers.franka.inverse_kinematics import ELBOW_JOINT, track
from drivers.franka.obstacles import solids_of
from drivers.franka.plane import StripPlane
from drivers.franka.reach import Reach, densify
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.twin.chain.engine import Chain
from tests.end_to_end.folded import Folded
from tests.support.franky_sim import franky_sim_model
from tests.support.maker_scene import PIECES, MakerScene, Moment
from tests.support.requests import request_for
from tests.support.twin_calibration import twin_calibration

TICK = 0.005  # s
GRASPED, RELEASED = 4, -2  # points of a whole path
OPEN = 0.04  # m between open fingers
LEAVING = 0.35  # s until the hand has left the edge, which rests on its lower pad


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
        start = self.reach.start
        poses, times = densify(path, speeds)
        due = np.cumsum(times) - times[0]
        plane = StripPlane(
            self.installation.mounting.transform(), turned=self.reach.turned
        )
        joints, elbow = start, float(start[ELBOW_JOINT])
        for time in np.arange(0.0, due[-1], TICK).tolist():
            pose = np.array([np.interp(time, due, column) for column in poses.T])
            tracked = track(joints, plane.matrix(*pose.tolist()), elbow, 12)
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


def scene_for(place: Installation, strip: StripFile) -> MakerScene:
    """The maker's arm in its `place` over a desk that ends with its `strip`."""
    ending = place.model_copy(update={"desk": strip.length})
    return MakerScene(franky_sim_model(), solids_of(ending), strip)


def lying(strip: StripFile) -> Array:
    """The flat strip's midline (n, 2) [m]."""
    along = np.linspace(0.0, strip.length, PIECES + 1)
    return np.column_stack([along, np.zeros_like(along)])


def beside(postures: Iterable[Array], strip: StripFile) -> Iterator[Moment]:
    """Yield moments of an open hand at `postures` (7,) [rad] while the `strip` lies."""
    flat = lying(strip)
    for joints in postures:
        yield Moment(flat[-1], joints, OPEN, flat, held=False)


def carried_out(fold: Folded, strip: StripFile) -> Iterator[Moment]:
    """Yield a robot's recorded `fold`, by the joints that it measured and the true
    strip.
    """
    table = pq.read_table(fold.run.folder / JOINTS)
    rows = [table["t"], *(table[f"q_{joint}"] for joint in range(1, 8))]
    begun = {e.facts.get("state", e.kind): e.t for e in fold.run.events()}
    grasped, released = begun["LIFT"], begun["RELEASE"]
    truth = fold.truth
    times = truth.t - fold.origin
    for t, *joints in np.column_stack(rows)[:: round(1e3 * TICK)].tolist():
        resting = released <= t < begun["released"] + LEAVING
        at = int(np.searchsorted(times, released if resting else t))
        at = min(at, len(times) - 1)
        held = grasped <= t < released
        loose = OPEN if t < grasped else strip.thickness + LOOSE
        width = strip.thickness if held else loose
        yield Moment(truth.edge[at], np.array(joints), width, truth.shapes[at], held)


def plan(name: str, runs: Path) -> Plan:
    """The fold of the strip `name` as the cell plans it, by a policy that knows it."""
    cell = find_configs(None).cell().with_drivers("fci")
    seen_by = twin_calibration(cell.twin.camera)
    made = assess(request_for(name, "planned", runs, cell=cell), seen_by)
    strip, place = made.request.strip, made.request.settings.installation
    ending = place.model_copy(update={"desk": strip.length})
    reach = made.require().reach.reach
    return Plan(ending, strip, made.path, made.speeds, reach)
