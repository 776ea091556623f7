"""Folds of the whole cell, through images, on the twin: made once, read by many
claims.
"""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import cell.folding.fold
from cell.base.devices.devices import Devices
from cell.folding.fold import fold
from cell.folding.request import Request
from cell.folding.result import FoldResult
from cell.record.run import Run, read_run
from cell.setup.calibration_in_use import calibration_of
from tests.support.twin_moves import Steps


@dataclass(frozen=True)
class Folded:
    result: FoldResult
    run: Run
    truth: SimpleNamespace
    origin: float

    def true_shape(self, t: float) -> np.ndarray:
        """The true midline (n, 2) at `t` of the run."""
        shapes = self.truth.shapes
        time, times = t + self.origin, self.truth.t
        after = int(np.clip(np.searchsorted(times, time), 1, len(times) - 1))
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        before, behind = shapes[after - 1], shapes[after]
        return before + share * (behind - before)


def fold_and_keep(request: Request) -> Folded:
    """Fold, and keep the twin's truth besides."""
    kept: list[Steps] = []
    open_cell = cell.folding.fold.open_cell

    def keeping(*arguments, **options) -> Devices:
        devices = open_cell(*arguments, **options)
        kept.append(Steps(devices.plant.twin.world))
        return devices

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cell.folding.fold, "open_cell", keeping)
        result = fold(request, calibration_of(request.cell))
    run = read_run(Path(result.run))
    begun = next(
        event for event in run.events() if event.facts.get("state") == "PREFLIGHT"
    )
    return Folded(result, run, kept[-1].truth(), origin=-begun.t)
