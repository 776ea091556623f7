"""Measured folds of denim, simulated by the rod with noise, to test the strip
subject.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.runs import MeasuredRun, read_runs
from cell.gap.subject.strip.subject import StripSubject, open_strip
from cell.gap.subject.strip.synthetic import (
    BENCH,
    Fold,
    reported_path,
    rod_folds,
    write_fold,
)
from cell.gap.subject.subject import Residuals
from cell.record.header import Sigma
from drivers.base.types import Array
from drivers.strip.describe import describe, load_strip
from drivers.strip.file import StripFile
from drivers.strip.model import Effects
from policies.experiments.standard import STANDARD

STRIP = Path("configs/strips/denim.yaml")
FEELING = BENCH.model_copy(update={"force": 0.001})
"""Noise of a cell that measures the force, too."""

SEGMENTS, STEP = 150, 0.004
"""Of the plant's rod: neither the coarse nor the fine one of the model."""


def denim() -> StripFile:
    """Strip file of denim that the controller uses."""
    return load_strip(STRIP)


def folds(
    names: Sequence[str], effects: Effects | None = None, **changes: float
) -> list[Fold]:
    """Simulated standard motions of a denim with `effects` and changed fields."""
    plant = denim().model_copy(update=changes)
    models = [describe(plant, effects or {}, i) for i in range(len(names))]
    made = rod_folds(
        models, [reported_path(STANDARD[n].over(0.6)) for n in names], SEGMENTS, STEP
    )
    return [
        replace(f, index=i, condition=n)
        for i, (f, n) in enumerate(zip(made, names, strict=True))
    ]


def written(
    root: Path, made: Sequence[Fold], by: Sigma = BENCH, seed: int = 0, **flaws: float
) -> list[Path]:
    """Folders of the folds `made`, written with noise, in their order."""
    rng = np.random.default_rng(seed)
    for fold in made:
        write_fold(
            root / f"{fold.index:02d}-{fold.condition}", "denim", fold, by, rng, **flaws
        )
    return sorted(root.iterdir())


def opened(*roots: Path) -> StripSubject:
    """The strip as its file states it, with the runs in the folders `roots`."""
    return open_strip(STRIP, find_runs(roots))


def read(root: Path) -> list[MeasuredRun]:
    """Runs of the strip in the folder `root`, as they were measured."""
    return read_runs(find_runs([root]), denim())


def residuals(
    strip: StripSubject, effects: dict[str, Array] | None = None
) -> list[Residuals]:
    """Residuals of every run at the stated base, corrected for the coarse rod there."""
    asked = [strip.stated(run, effects) for run in strip.runs]
    refined = strip.refine(asked)
    return strip.simulate(
        [replace(q, run=run) for q, run in zip(asked, refined, strict=True)]
    )


def in_noise(strip: StripSubject, found: Sequence[Residuals], channel: str) -> float:
    """Root mean square residual of a channel, in standard deviations of its noise
    alone.
    """
    rows = [
        (r.mean / run.samples.noise)[run.samples.channel == channel]
        for run, r in zip(strip.runs, found, strict=True)
    ]
    return float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))


def whitened(strip: StripSubject, found: Sequence[Residuals]) -> Array:
    """All residuals in units of noise and floor (N,)."""
    parts = [
        r.mean / np.hypot(run.samples.noise, run.samples.floor)
        for run, r in zip(strip.runs, found, strict=True)
    ]
    return np.concatenate(parts)
