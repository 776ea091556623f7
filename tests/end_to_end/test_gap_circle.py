"""The circle closes: a strip that folds badly is explored, its model mended, and it
folds well.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest

from cell.base.config.places import Configs, find_configs
from cell.base.devices.devices import Trial
from cell.folding.fold import fold
from cell.folding.request import Request, standard_requests
from cell.gap.fit import fit
from cell.gap.verdict.accept import accept
from cell.setup.calibration_in_use import calibration_of
from drivers.strip.describe import load_plant
from drivers.strip.file import StripFile

pytestmark = pytest.mark.long

DENIM, FOLDER = find_configs(None).strip("denim"), find_configs(None).folder


class Circle:
    """Denim whose `plant` lies on the desk, by a copy of the configuration in `work`,
    into which accepted effects are written.
    """

    def __init__(self, plant: StripFile, work: Path) -> None:
        self.plant, self.work = plant, work
        self.configs = Configs(shutil.copytree(FOLDER, work / "configs"))

    def request(self, when: str, seed: int) -> Request:
        strip, trial = self.configs.strip("denim"), Trial(plant=self.plant, seed=seed)
        return Request(self.configs.cell(), strip, "planned", self.work / when, trial)

    def folded(self, when: str, first: int) -> np.ndarray:
        """Sizes (2, 2) [mm] of the seen and the true displacements of two folds."""
        requests = [self.request(when, first + i) for i in range(2)]
        found = [fold(each, calibration_of(each.cell)) for each in requests]
        sizes = [(each.displacement, each.displacement_true) for each in found]
        return 1e3 * np.abs(sizes).T

    def learn(self) -> list[str]:
        """Fold the standard runs, fit and accept; returns the names of the effects."""
        for each in standard_requests(self.request("standard", 1000)):
            fold(each, calibration_of(each.cell))
        file = self.configs.strip_path("denim")
        verdict = fit([self.work / "standard"], file, self.work / "fit")
        accept(self.work / "fit", file, self.configs.folder / "cell.yaml")
        return [effect.name for effect in verdict.effects]


def test_friction_of_denim_is_learned_and_the_planned_fold_lies_even(
    tmp_path: Path,
) -> None:
    circle = Circle(load_plant(FOLDER / "plants" / "denim.yaml"), tmp_path)
    assert circle.folded("before", 0).min() > 10.0
    assert "bending_hysteresis" in circle.learn()
    assert circle.folded("after", 2000).max() < 5.0


def test_tool_longer_than_stated_is_learned_and_the_arm_makes_up_for_it(
    tmp_path: Path,
) -> None:
    tool = {"tcp_offset": {"x": 0.0, "z": -0.008}}  # m
    circle = Circle(DENIM.model_copy(update={"effects": tool}), tmp_path)
    seen, true = circle.folded("before", 0)
    assert true.min() > 6.0
    # the camera trusts the arm, and is deceived with it
    assert seen.max() < 4.0
    assert circle.learn() == ["tcp_offset"]
    assert circle.folded("after", 2000).max() < 3.0
