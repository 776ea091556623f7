"""Finds replicated runs, whose gripper paths agree within an arm's repeatability."""

from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from cell.gap.subject.strip.prepare import Fold
from cell.gap.subject.subject import Run
from drivers.strip.rod.motions import GripperPath

PATH_TOLERANCE = np.array(
    [5e-4, 5e-4, 0.005]
)  # m, m, rad between two paths; arms repeat within a fifth
SAME_START = 1e-3  # s between the beginnings of two paths


def replicates(runs: Sequence[Run]) -> Mapping[bytes, Fold]:
    """Map each fold's path, by digest, to the fold that is simulated in its place.

    An effect changes replicates alike, up to far less than the error of a rough time step.
    """
    leaders: list[Fold] = []
    found = {}
    folds = [cast(Fold, run.content) for run in runs]
    for fold in sorted(folds, key=lambda f: -f.path.rows.t[-1]):
        leader = next((f for f in leaders if _is_replicate(f, fold)), fold)
        if leader is fold:
            leaders.append(fold)
        found[fold.path.digest] = leader
    return found


def _is_replicate(longer: Fold, fold: Fold) -> bool:
    """Whether the path of `longer` can be simulated in place of `fold`, which ends no later."""
    if longer.comparison.run.contact_height != fold.comparison.run.contact_height:
        return False
    first, second = longer.path.rows, fold.path.rows
    if first.hanging != second.hanging or abs(first.t[0] - second.t[0]) > SAME_START:
        return False
    return _is_near(first, second) and _is_near(longer.lifted_path.rows, fold.lifted_path.rows)


def _is_near(longer: GripperPath, path: GripperPath) -> bool:
    """Whether the poses of `path` lie within PATH_TOLERANCE of those of `longer` at equal times."""
    other = np.stack([np.interp(path.t, longer.t, c) for c in longer.poses.T], axis=1)
    return bool((np.abs(path.poses - other) < PATH_TOLERANCE).all())
