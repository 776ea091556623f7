"""Folds that are measured from a strip that hangs: a gap in them is named as in flat ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.gap.fit import fit
from cell.gap.subject.strip.synthetic import Fold, reported_path, rod_folds
from cell.gap.verdict.schema import Verdict
from drivers.strip.describe import describe
from drivers.strip.rod.motions import GripperPath
from policies.experiments.standard import STANDARD
from policies.path import TAKEOVER_HEIGHT
from tests.support.gap_strip_cases import SEGMENTS, STEP, STRIP, denim, written

pytestmark = pytest.mark.slow

NAMES = ("normal", "slow-low", "there-and-back", "fast", "shake", "normal")
PAUSE = 1.0  # s after the lift
YIELD = 10.0  # 1/m


def paused(path: GripperPath) -> tuple[GripperPath, float]:
    """The path with a pause at the height of take-over, and when [s] the pause is over."""
    row = int(np.argmax(path.poses[:, 1] >= TAKEOVER_HEIGHT))
    rest = np.arange(0.01, PAUSE, 0.01)
    t = np.concatenate([path.t[: row + 1], path.t[row] + rest, path.t[row + 1 :] + PAUSE])
    still = np.repeat(path.poses[row : row + 1], len(rest), axis=0)
    poses = np.concatenate([path.poses[: row + 1], still, path.poses[row + 1 :]])
    return path._replace(t=t, poses=poses), float(path.t[row]) + PAUSE


def hanging(fold: Fold, begin: float) -> Fold:
    """What is measured of a fold from `begin` [s] on."""
    motion, path, touch = fold.motion, fold.path, fold.motion.touch
    rows, moved, shown = path.t >= begin, motion.t > begin, fold.shape_t > begin
    series = ("poses", "contact_x", "tip", "holding_force", "grip_force")
    kept = {n: getattr(motion, n)[moved] for n in series}
    kept |= {"t": motion.t[moved] - begin, "shapes": motion.shapes[shown]}
    kept["touch"] = None if touch is None else replace(touch, time=touch.time - begin)
    return replace(
        fold,
        path=GripperPath(path.t[rows] - begin, path.poses[rows], hanging=True),
        motion=replace(motion, **kept),
        shape_t=fold.shape_t[shown] - begin,
    )


@pytest.fixture(scope="module")
def verdict(tmp_path_factory: pytest.TempPathFactory) -> Verdict:
    """The verdict on folds of a strip whose yarns rub, each with its lift before the first row."""
    root = tmp_path_factory.mktemp("hanging")
    plant = denim().model_copy(update={"retardation_time": 0.05})
    yarns = {"bending_hysteresis": {"yield_curvature": YIELD}}
    models = [describe(plant, yarns, i) for i in range(len(NAMES))]
    paths = [paused(reported_path(STANDARD[name].of(0.6))) for name in NAMES]
    made = rod_folds(models, [path for path, _ in paths], SEGMENTS, STEP)
    cut = [
        replace(hanging(fold, begin), index=i, condition=name)
        for i, (fold, (_, begin), name) in enumerate(zip(made, paths, NAMES, strict=True))
    ]
    written(root / "runs", cut)
    return fit([root / "runs"], Path(STRIP), root / "out", jobs=1)


def test_friction_between_yarns_is_named_with_its_size(verdict: Verdict) -> None:
    assert verdict.verdict == "named"
    assert [effect.name for effect in verdict.effects] == ["bending_hysteresis"]
    found = verdict.effects[0].parameters["yield_curvature"]
    assert found.value == pytest.approx(YIELD, rel=0.25)
    assert verdict.gap.shrink > 0.5
