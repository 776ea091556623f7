"""The base alone, refitted as the workflow does it before it looks for anything."""

from pathlib import Path

import numpy as np

from cell.gap.diagnosis import held_out_gap
from cell.gap.fitting.model import Model, evidence
from cell.gap.fitting.starts import refit_base
from cell.gap.opening import open_subject
from cell.gap.selection.hold_out import held_out
from cell.gap.subject.run_folders import find_runs


def base_of(strip: Path, runs: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Values of the base by name, and the gap that it leaves on held-out runs: `excess`, and root
    mean squares by quantity in the unit of its name.
    """
    subject = open_subject(strip, find_runs([runs]), jobs=1)
    held = held_out(subject, subject.simulate)
    train, test = (
        evidence([run for run in subject.runs if (run.name in held) is wanted])
        for wanted in (False, True)
    )
    base = refit_base(subject.simulate, Model(subject.scope.base), train, np.random.default_rng(0))
    unseen = held_out_gap.unseen(subject.simulate, base, test)
    names = (p.name for p in subject.scope.base)
    values = dict(zip(names, base.shared.tolist(), strict=True))
    return values, held_out_gap.sizes(unseen, subject.scope.quantities)
