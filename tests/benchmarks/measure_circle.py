"""Closes the circle: folds badly, finds what the model lacks, accepts it, folds anew.

python -m tests.benchmarks.measure_circle [--strip denim] [--plant configs/plants/denim.yaml]
    [--hidden "{tcp_offset: {x: 0.0, z: -0.008}}"] [--scatter full] [--repeat 3] [--jobs 1]
    [--work DIR]

With --scatter runs differ from one another as in the exam: at `full` by 0.3 mm of the grip in x and
in z, 5 % of damping and 0.5 % of stiffness, one sigma each.
"""

import argparse
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from cell.config.places import find_configs
from cell.devices.devices import DeviceSelection
from cell.exam.case import Scattered
from cell.exam.runs.scatter import LEVELS
from cell.exam.runs.through_images import Open
from cell.folding.fold import Request, fold
from cell.folding.result import FoldResult
from cell.folding.standard_runs import check_empty, fold_runs, standard_requests
from cell.gap.fit import fit
from cell.gap.verdict.accept import accept
from cell.gap.verdict.schema import Verdict
from drivers.strip.describe import load_plant
from drivers.types import Array
from drivers.yaml_edit import dump_text

BEFORE, STANDARD, AFTER = 0, 1000, 2000  # first seeds: no noise is seen twice
Effects = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class Circle:
    """`strip` as the cell knows it, the `plant` on the desk, and a folder to `work` in.

    The configuration that is accepted into is a copy in that folder. Runs differ from one another
    by `scatter`, which is folded in this process, one at a time.
    """

    strip: str
    plant: Path
    work: Path
    jobs: int = 1
    scatter: Scattered = "none"

    @property
    def configs(self) -> Path:
        """The copy of the configuration."""
        return self.work / "configs"

    @property
    def file(self) -> Path:
        """The strip's file in it."""
        return self.configs / "strips" / f"{self.strip}.yaml"

    def fold(self, when: str, first: int, count: int) -> list[FoldResult]:
        """`count` folds by the path planned from the strip file as it is, seeds from `first`."""
        runs = self.work / when
        wanted = [self._request("planned", runs, first + i) for i in range(count)]
        return list(self._folded(wanted))

    def learn(self) -> Verdict:
        """Fold the standard runs, compare, and accept what is named; else nothing changes."""
        runs, out = self.work / "standard", self.work / "fit"
        for _ in self._folded(standard_requests(self._request("", runs, STANDARD))):
            pass
        verdict = fit([runs], self.file, out, jobs=self.jobs)
        if verdict.verdict == "named":
            accept(out, self.file, self.configs / "cell.yaml")
        return verdict

    def _folded(self, wanted: Sequence[Request]) -> Iterator[FoldResult]:
        if self.scatter == "none":
            yield from fold_runs(wanted, self.jobs)
            return
        for request in wanted:
            yield fold(request, opened=Open([], request.choice.seed, self.scatter), page=False)

    def _request(self, policy: str, runs: Path, seed: int) -> Request:
        choice = DeviceSelection(plant=self.plant, seed=seed)
        return Request(
            self.strip, policy, None, choice, runs, self.configs, None, truth=True, viz="off"
        )


def begin(
    strip: str, plant: Path | Effects, work: Path, jobs: int = 1, scatter: Scattered = "none"
) -> Circle:
    """A circle in the new folder `work`: the plant is a file, or the strip with effects hidden."""
    configs = find_configs(None)
    check_empty(work / "before")
    shutil.copytree(configs.folder, work / "configs", dirs_exist_ok=True)
    if not isinstance(plant, Path):
        content = configs.strip(strip).model_dump(mode="json", by_alias=True)
        hidden = {name: dict(values) for name, values in plant.items()}
        plant, text = work / "plant.yaml", dump_text(content | {"effects": hidden})
        plant.write_text(text, encoding="utf-8")
    load_plant(plant)
    return Circle(strip, plant, work, jobs, scatter)


def millimetres(folds: Sequence[FoldResult]) -> Array:
    """Displacements (n, 2) [mm], as seen and true; NaN without a touch."""
    each = [(fold.displacement, fold.displacement_true) for fold in folds]
    return 1e3 * np.array(each, dtype=np.float64)


def rows(when: str, folds: Sequence[FoldResult]) -> list[str]:
    """A line a fold, and one of the mean misalignment."""
    d = millimetres(folds)
    lines = [
        f"{when:7s} {fold.seed:6d} {seen:+8.1f} {true:+8.1f}   {fold.outcome}"
        for fold, (seen, true) in zip(folds, d, strict=True)
    ]
    seen, true = np.abs(d).mean(axis=0)
    return [*lines, f"{when:7s} mean|d|{seen:8.1f} {true:8.1f}"]


def told(verdict: Verdict) -> list[str]:
    """What was found, with intervals."""
    lines: list[str] = [verdict.verdict]
    for effect in verdict.effects:
        for name, p in effect.parameters.items():
            lines.append(f"  {effect.name}.{name} {p.value:.4g} ({p.low} to {p.high}) {p.unit}")
    lines += [f"  cannot tell apart: {', '.join(names)}" for names in verdict.ambiguous]
    if verdict.unexplained is not None:
        lines.append(f"  {verdict.unexplained.description}")
    gap = verdict.gap
    lines.append(f"  shrink {gap.shrink:.2f} ({gap.shrink_low:.2f} to {gap.shrink_high:.2f})")
    lines.append(f"  {verdict.simulations} simulations, {verdict.runtime:.0f} s")
    return lines


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strip", default="denim")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--plant", type=Path, default=Path("configs/plants/denim.yaml"))
    what.add_argument("--hidden", type=yaml.safe_load, help="effects of the plant, as YAML")
    parser.add_argument("--scatter", choices=tuple(LEVELS), default="none")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--work", type=Path, default=Path("runs/circle"))
    return parser.parse_args()


def say(lines: Sequence[str]) -> None:
    print("\n".join(lines), flush=True)


def main() -> None:
    asked = arguments()
    plant = asked.hidden or asked.plant
    circle = begin(asked.strip, plant, asked.work, asked.jobs, asked.scatter)
    say(["when      seed  seen/mm  true/mm"])
    say(rows("before", circle.fold("before", BEFORE, asked.repeat)))
    verdict = circle.learn()
    say(told(verdict))
    if verdict.verdict != "named":
        sys.exit(1)
    say(rows("after", circle.fold("after", AFTER, asked.repeat)))


if __name__ == "__main__":
    main()
