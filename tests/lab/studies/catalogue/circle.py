"""Study of the whole learning cycle: fold, find and accept the missing effect, fold
again.

Folds by the path planned from the strip file, before and after the standard runs were
compared with their simulation; configuration is a copy. No noise is seen twice.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.base.config.places import Configs, find_configs
from cell.base.devices.devices import Trial
from cell.folding.fold import fold
from cell.folding.request import Request, standard_requests
from cell.folding.result import FoldResult
from cell.gap.fit import fit
from cell.gap.verdict.accept import accept
from cell.setup.calibration_in_use import calibration_of
from drivers.strip.describe import load_plant
from drivers.strip.file import StripFile
from tests.lab.exam.case import ScatterLevel
from tests.lab.exam.through_images import ExamTwin
from tests.lab.studies.study import Quantity, Statistic, Study, Values, percentage

SEEDS_BEFORE, SEEDS_STANDARD, SEEDS_AFTER = 0, 1000, 2000  # first seeds
SEEDS_NEXT = 10_000  # of the next time round
HIDDEN_VALUES: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "friction of the yarns": {},  # the strip's plant
    "tool longer than stated": {"tcp_offset": {"x": 0.0, "z": -0.008}},  # m
    "tool off both ways": {"tcp_offset": {"x": 0.008, "z": -0.006}},
}
SCATTER: tuple[ScatterLevel, ...] = ("none", "full")


@dataclass(frozen=True, slots=True)
class Circle:
    """Case of the learning cycle: known `strip`, true `plant`, and a folder `work`.

    Runs differ from one another by `scatter` as in the exam: at `full` by 0.3 mm of the
    grip in x and in z, 5 % of damping and 0.5 % of stiffness, one sigma each.
    """

    strip: str
    plant: StripFile
    work: Path
    scatter: ScatterLevel = "none"

    @property
    def configs(self) -> Path:
        """Folder of the configuration's copy, into which accepted effects are
        written.
        """
        return self.work / "configs"

    def fold(self, when: str, first: int, count: int) -> list[FoldResult]:
        """Fold `count` times on the path planned from the strip file, with seeds from
        `first`.
        """
        wanted = [self._request("planned", when, first + i) for i in range(count)]
        return list(self._fold_each(wanted))

    def learn(self, first: int) -> list[str]:
        """Fold the standard runs, fit, and accept the named effects; returns their
        names.
        """
        for _ in self._fold_each(
            standard_requests(self._request("", "standard", first))
        ):
            pass
        file = self.configs / "strips" / f"{self.strip}.yaml"
        verdict = fit([self.work / "standard"], file, self.work / "fit")
        if verdict.verdict == "named":
            accept(self.work / "fit", file, self.configs / "cell.yaml")
        return [effect.name for effect in verdict.effects]

    def _fold_each(self, wanted: Sequence[Request]) -> Iterator[FoldResult]:
        if self.scatter == "none":
            yield from (
                fold(request, calibration_of(request.cell)) for request in wanted
            )
            return
        for request in wanted:
            settings, strip, trial = request.settings, request.strip, request.trial
            opened = ExamTwin([], trial.seed, self.scatter)
            devices = opened(settings, strip, trial, calibrating=False)
            yield fold(request, calibration_of(settings), devices=devices)

    def _request(self, policy: str, when: str, seed: int) -> Request:
        """Request by the files as they are now: accepted effects are in them."""
        configs, trial = Configs(self.configs), Trial(plant=self.plant, seed=seed)
        known = (
            configs.cell(),
            configs.strip(self.strip),
            policy,
            self.work / when,
            trial,
        )
        return Request(*known)


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through the hidden effects, without scatter and then
    with it.
    """
    number, which = divmod(number, len(HIDDEN_VALUES))
    turn, level = divmod(number, len(SCATTER))
    return {
        "strip": "denim",
        "hidden": list(HIDDEN_VALUES)[which],
        "scatter": SCATTER[level],
        "folds": 3,
        "noise": turn,
    }


def measure(case: Values) -> Values:
    """Seen and true displacements [m] before and after, and the effects accepted in
    between.
    """
    configs, first, count = (
        find_configs(None),
        SEEDS_NEXT * case["noise"],
        case["folds"],
    )
    with TemporaryDirectory() as place:
        work = Path(place)
        shutil.copytree(configs.folder, work / "configs")
        plant = load_plant(configs.folder / "plants" / f"{case['strip']}.yaml")
        if hidden := HIDDEN_VALUES[case["hidden"]]:
            plant = configs.strip(case["strip"]).model_copy(update={"effects": hidden})
        circle = Circle(case["strip"], plant, work, case["scatter"])
        before = circle.fold("before", first + SEEDS_BEFORE, count)
        named = circle.learn(first + SEEDS_STANDARD)
        after = circle.fold("after", first + SEEDS_AFTER, count)
    return {
        "named": named,
        "learned": bool(named),
        "before_seen": [each.displacement for each in before],
        "before_true": [each.displacement_true for each in before],
        "after_seen": [each.displacement for each in after],
        "after_true": [each.displacement_true for each in after],
    }


STUDY = Study(
    name="circle",
    question=(
        "Does a strip fold better once what its model lacked was found and accepted?"
    ),
    draw=draw,
    measure=measure,
    by=("strip", "hidden", "scatter"),
    quantities=(
        Quantity("before_true", Statistic.MEAN_SIZE, label="mean |d| before"),
        Quantity("after_true", Statistic.MEAN_SIZE, label="after"),
        Quantity("before_seen", Statistic.MEAN_SIZE, label="mean |d| as seen before"),
        Quantity("after_seen", Statistic.MEAN_SIZE, label="as seen after"),
        percentage("learned", "learned"),
    ),
    usual=6,
    quick=0,
    seconds=200.0,
)
