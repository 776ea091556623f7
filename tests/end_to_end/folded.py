"""Folds of the whole cell, through images, on the twin: made once, read by many claims."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import cell.folding.fold
from cell.calibrate.calibration_in_use import calibration_of
from cell.devices.devices import Devices
from cell.folding.fold import fold
from cell.folding.request import Request
from cell.folding.result import FoldResult
from cell.record.run import Run, read_run
from drivers.twin.scene import Truth


@dataclass(frozen=True)
class Folded:
    result: FoldResult
    run: Run
    truth: Truth
    origin: float

    def true_shape(self, t: float) -> np.ndarray:
        """The true midline (n, 2) at `t` of the run."""
        time, times = t + self.origin, self.truth.t
        after = int(np.clip(np.searchsorted(times, time), 1, len(times) - 1))
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        before, behind = self.truth.shapes[after - 1], self.truth.shapes[after]
        return before + share * (behind - before)


def fold_and_keep(request: Request) -> Folded:
    """Fold, and keep the twin's truth besides."""
    opened: list[Devices] = []
    open_cell = cell.folding.fold.open_cell

    def keeping(*arguments, **options) -> Devices:
        opened.append(open_cell(*arguments, **options))
        return opened[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cell.folding.fold, "open_cell", keeping)
        result = fold(request, calibration_of(request.cell))
    run = read_run(Path(result.run))
    truth = opened[-1].plant.twin.world.truth()
    begun = next(event for event in run.events() if event.facts.get("state") == "PREFLIGHT")
    return Folded(result, run, truth, origin=-begun.t)
