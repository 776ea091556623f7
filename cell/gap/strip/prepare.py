"""Measured folds made ready for the engine: their samples, and what a finer rod shows otherwise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.gap.strip.compare import Comparison
from cell.gap.strip.layout import Floors, layout
from cell.gap.strip.runs import Measured, MeasuredRun
from cell.gap.strip.simulation import FINE, Drive, Shown, Simulation
from cell.gap.subject import Residuals, Run
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel, describe
from drivers.strip.rod.motions import Way
from drivers.types import Array, frozen

TRUSTED = (
    1.0  # of the change that a finer rod makes: another engine, and a strip, may differ as much
)
MOST = 20.0  # floors: a larger change is no matter of the grain but of another fold
LATER = 0.6  # s after the measured touch in which the model may still touch


@dataclass(frozen=True, slots=True)
class Fold:
    """A measured fold: the reported way that drives the model, how it is compared, `index`, and
    what a finer rod shows more than the coarse one `finer` (n,), per sample.
    """

    way: Way
    comparison: Comparison
    index: int
    finer: Array

    def drive(self, model: StripModel) -> Drive:
        """What is simulated of this fold with `model`."""
        height = self.comparison.run.contact_height
        observation = replace(model.observation, contact_height=height)
        return Drive(replace(model, observation=observation), self.way)

    def residuals(self, drive: Drive, shown: Shown | None) -> Residuals:
        """Measured minus simulated, as a fine rod would have it."""
        found = self.comparison(drive.model, shown)
        mean = found.mean - self.finer
        return Residuals(mean, found.square + mean**2 - found.mean**2)


def prepared(
    runs: Sequence[MeasuredRun], strip: StripFile, floors: Floors, coarse: Simulation, jobs: int
) -> list[Run]:
    """The runs as the engine takes them; those without a sample are left out."""
    folds = [_fold(run.measured, strip, floors) for run in runs]
    drives = [f.drive(describe(strip, index=f.index)) for f in folds]
    fine = Simulation(FINE, jobs)
    shown = zip(coarse(drives), fine(drives), strict=True)
    ready = []
    for run, fold, drive, (rough, exact) in zip(runs, folds, drives, shown, strict=True):
        samples = fold.comparison.layout.samples
        if not len(samples):
            continue
        change = fold.comparison(drive.model, rough).mean - fold.comparison(drive.model, exact).mean
        finer = np.nan_to_num(change)
        finer = np.where(np.abs(finer) < MOST * samples.floor, finer, 0.0)
        samples = replace(samples, floor=np.hypot(samples.floor, TRUSTED * finer))
        content = replace(fold, finer=frozen(finer))
        ready.append(Run(run.name, run.condition, samples, index=fold.index, content=content))
    return ready


def _fold(run: Measured, strip: StripFile, floors: Floors) -> Fold:
    chosen = layout(run, strip.length, floors)
    kept = run.t <= run.end + LATER
    way = Way(run.t[kept], run.poses[kept], run.hanging)
    comparison = Comparison(run, chosen, strip.length)
    return Fold(way, comparison, run.index, np.zeros(len(chosen.samples)))
