"""Hierarchical Gaussian model of a cell's bias, by cell, strip, specimen, and error of the rig.

A fold's measured minus predicted displacement is y = c + s + p + noise with the bias c of the cell,
s of the strip and p of the specimen, independent normal priors (a linear mixed model; Pinheiro and
Bates, 2000, ch. 2). A ruler measures r, the rig's error, alone. c and r begin anew where two folds
in a row show that the cell changed. A fold that deviates alone is an outlier, and left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.config.settings import LearningSettings
from cell.learning.experience import Experience
from cell.learning.shrinkage import Parts, laid_offset, shrunk
from drivers.types import Array

# sigmas of one fold that is set aside until the next one comes: 6e-5 by chance
OUTLIER_SIGMAS = 4.0
# sigmas of two folds in a row, to the same side, that show a change: 8e-5 by chance
CHANGE_SIGMAS = 2.5

Unknown = tuple[str, str | int]  # a level of the hierarchy and its member
Row = tuple[tuple[Unknown, ...], float, float]  # unknowns, their measured sum, its sigma


@dataclass(frozen=True, slots=True)
class Bias:
    """Bias [m] of the next fold: mean and sigma as `seen` by the camera, mean error of the `rig`.

    `laid` is the offset [m] at which the cell lays edges. `parts` [m] are the means of
    cell, strip and specimen. `folds` counts the measured folds since the cell last changed, at the
    run `since`; it is None while no change was seen.
    """

    seen: float
    sigma: float
    rig: float
    parts: Parts
    folds: int
    since: str | None
    laid: float = 0.0


def bias(
    experiences: Sequence[Experience], strip: str, specimen: str, settings: LearningSettings
) -> Bias:
    """Bias learned from `experiences` with one policy for a fold of `specimen` of `strip`."""
    learner = _Learner(settings)
    for experience in experiences:
        learner.learn(experience)
    found = learner.bias(strip, specimen)
    if found.since is None and learner.epoch:
        parts = shrunk(found.parts, learner.epoch, strip, specimen, settings)
        found = replace(found, seen=sum(parts), parts=parts)
    return replace(found, laid=laid_offset(learner.epoch, found.rig, settings))


class _Learner:
    """Learner of the bias, fold by fold, in epochs within which the cell did not change."""

    def __init__(self, settings: LearningSettings) -> None:
        self._settings = settings
        self._rows: list[Row] = []
        self._change_runs: list[str] = []  # names of the runs that began a new epoch
        self._epoch_rows: list[int] = []  # indices into `_rows` of this epoch's folds
        self.epoch: list[Experience] = []  # this epoch's folds, in the order of `_epoch_rows`
        # the last fold and its surprise [sigmas]; None before the first and after a change
        self._previous_fold: tuple[float, Experience] | None = None

    def learn(self, experience: Experience) -> None:
        """Add the next experience; two in a row that deviate to one side start a new epoch."""
        if experience.kind == "ruler":
            self._rows.append(((self._rig,), experience.rig, self._settings.ruler))
            return
        surprise, before = self._surprise(experience), self._previous_fold
        self._previous_fold = (surprise, experience)
        if before is not None and _shows_change(before[0], surprise):
            self._start_epoch(*before)
            self._previous_fold = None
        elif abs(surprise) > OUTLIER_SIGMAS:
            return
        self._add(experience)

    def _start_epoch(self, surprise: float, first: Experience) -> None:
        """Start an epoch with the fold `first`, which deviated by `surprise` [sigmas]."""
        if abs(surprise) <= OUTLIER_SIGMAS:
            self._rows.pop(self._epoch_rows[-1])
        self._change_runs.append(first.run)
        self._epoch_rows, self.epoch = [], []
        self._add(first)

    def _surprise(self, experience: Experience) -> float:
        """Deviation of a fold from the bias so far, in sigmas; 0 for the first of an epoch."""
        if not self._epoch_rows:
            return 0.0
        mean, variance = self._predict(self._unknowns_of(experience.strip, experience.specimen))
        sigma = np.hypot(np.sqrt(variance), self._settings.repeat)
        return float((experience.displacement - mean) / sigma)

    def _add(self, experience: Experience) -> None:
        self._epoch_rows.append(len(self._rows))
        self.epoch.append(experience)
        unknowns = self._unknowns_of(experience.strip, experience.specimen)
        self._rows.append((unknowns, experience.displacement, self._settings.repeat))

    def bias(self, strip: str, specimen: str) -> Bias:
        """Bias of the next fold of `specimen` of fabric `strip`."""
        unknowns = self._unknowns_of(strip, specimen)
        mean, variance = self._predict(unknowns)
        rig, _ = self._predict((self._rig,))
        each = [self._predict((unknown,))[0] for unknown in unknowns]
        return Bias(
            seen=mean,
            sigma=float(np.hypot(np.sqrt(variance), self._settings.repeat)),
            rig=rig,
            parts=(each[0], each[1], each[2]),
            folds=len(self._epoch_rows),
            since=self._change_runs[-1] if self._change_runs else None,
        )

    @property
    def _rig(self) -> Unknown:
        return ("rig", len(self._change_runs))

    def _unknowns_of(self, strip: str, specimen: str) -> tuple[Unknown, ...]:
        return (
            ("cell", len(self._change_runs)),
            ("strip", strip),
            ("specimen", f"{strip}/{specimen}"),
        )

    def _sigma(self, unknown: Unknown) -> float:
        level, member = unknown
        if level == "cell" and member != 0:
            return self._settings.changed
        return float(getattr(self._settings, level))

    def _predict(self, unknowns: tuple[Unknown, ...]) -> tuple[float, float]:
        """Mean [m] and variance [m^2] of the sum of `unknowns`, given the rows."""
        names = sorted({*unknowns, *(name for row in self._rows for name in row[0])}, key=str)
        place = {name: i for i, name in enumerate(names)}
        precision = np.diag([self._sigma(name) ** -2 for name in names])
        weighted = np.zeros(len(names))
        for used, y, noise in self._rows:
            at = _indicator(used, place)
            precision += np.outer(at, at) / noise**2
            weighted += at * y / noise**2
        at = _indicator(unknowns, place)
        solved = np.linalg.solve(precision, np.column_stack([weighted, at]))
        return float(at @ solved[:, 0]), float(at @ solved[:, 1])


def _shows_change(first: float, second: float) -> bool:
    """Whether two deviations in a row [sigmas] are large and to the same side."""
    return min(abs(second), abs(first)) > CHANGE_SIGMAS and second * first > 0


def _indicator(unknowns: Sequence[Unknown], place: dict[Unknown, int]) -> Array:
    """Vector (n,) with ones at the places of `unknowns`, zeros elsewhere."""
    at = np.zeros(len(place))
    at[[place[name] for name in unknowns]] = 1.0
    return at
