"""Hierarchical Gaussian model of a cell's bias: cell, strip, specimen, and what no camera sees.

A fold's measured minus predicted displacement is y = c + s + p + noise with the bias c of the cell,
s of the strip and p of the specimen, independent normal priors (a linear mixed model; Pinheiro and
Bates, 2000, ch. 2). A ruler measures r, the rig's error, alone. c and r begin anew where the folds
show that the cell changed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.config.learning import LearningSettings
from cell.learning.experience import Experience
from drivers.types import Array

SURPRISE = 4.0  # sigmas of one fold that show a change: 6e-5 by chance
TWICE = 2.5  # sigmas of two folds in a row, to the same side: 8e-5 by chance

Unknown = tuple[str, str | int]  # a level of the hierarchy and its member


@dataclass(frozen=True, slots=True)
class Bias:
    """Bias of the next fold: mean and one sigma [m] of what the camera sees, and of the `rig`.

    `parts` [m] are the means of cell, strip and specimen. `folds` counts the measured folds since
    the cell last changed, at the run `since`; it is None while no change was seen.
    """

    seen: float
    sigma: float
    rig: float
    parts: tuple[float, float, float]
    folds: int
    since: str | None


def bias(
    experiences: Sequence[Experience], strip: str, specimen: str, settings: LearningSettings
) -> Bias:
    """Bias of a fold of `specimen`, of fabric `strip`, after `experiences` with one policy."""
    learner = _Learner(settings)
    for experience in experiences:
        learner.learn(experience)
    return learner.bias(strip, specimen)


class _Learner:
    """Experiences in order, cut into epochs between which the cell did not change."""

    def __init__(self, settings: LearningSettings) -> None:
        self._settings = settings
        self._rows: list[tuple[tuple[Unknown, ...], float, float]] = []  # unknowns, y, sigma
        self._runs: list[str] = []  # that began an epoch, from the second on
        self._epoch_folds: list[int] = []  # rows of the folds of this epoch
        self._last: float = 0.0  # surprise of the fold before

    def learn(self, experience: Experience) -> None:
        """Add the next experience; begin an epoch where it, or it and the one before, disagree."""
        if experience.kind == "ruler":
            self._rows.append(((self._rig,), experience.rig, self._settings.ruler))
            return
        unknowns = self._of(experience.strip, experience.specimen)
        mean, variance = self._predict(unknowns)
        y, noise = experience.displacement, self._settings.repeat
        surprise = (y - mean) / np.hypot(np.sqrt(variance), noise) if self._epoch_folds else 0.0
        twice = min(abs(surprise), abs(self._last)) > TWICE and surprise * self._last > 0
        if twice and len(self._epoch_folds) > 1:
            self._begin(experience.run, [self._epoch_folds[-1]])
        elif abs(surprise) > SURPRISE:
            self._begin(experience.run, [])
        self._last = surprise
        self._epoch_folds.append(len(self._rows))
        self._rows.append((self._of(experience.strip, experience.specimen), y, noise))

    def bias(self, strip: str, specimen: str) -> Bias:
        """Bias of the next fold."""
        unknowns = self._of(strip, specimen)
        mean, variance = self._predict(unknowns)
        rig, _ = self._predict((self._rig,))
        each = [self._predict((unknown,))[0] for unknown in unknowns]
        return Bias(
            seen=mean,
            sigma=float(np.hypot(np.sqrt(variance), self._settings.repeat)),
            rig=rig,
            parts=(each[0], each[1], each[2]),
            folds=len(self._epoch_folds),
            since=self._runs[-1] if self._runs else None,
        )

    @property
    def _rig(self) -> Unknown:
        return ("rig", len(self._runs))

    def _of(self, strip: str, specimen: str) -> tuple[Unknown, ...]:
        return ("cell", len(self._runs)), ("strip", strip), ("specimen", f"{strip}/{specimen}")

    def _begin(self, run: str, taken_along: list[int]) -> None:
        """An epoch that begins with the folds `taken_along`, rows of the one before."""
        self._runs.append(run)
        self._epoch_folds = taken_along
        for row in taken_along:
            unknowns, y, noise = self._rows[row]
            self._rows[row] = ((("cell", len(self._runs)), *unknowns[1:]), y, noise)

    def _sigma(self, unknown: Unknown) -> float:
        level, member = unknown
        if level == "cell" and member != 0:
            return self._settings.changed
        return float(getattr(self._settings, level))

    def _predict(self, unknowns: tuple[Unknown, ...]) -> tuple[float, float]:
        """Mean [m] and variance [m^2] of the sum of `unknowns`, given the rows."""
        rows = [(*row, unknowns) for row in self._rows]
        names = sorted({*unknowns, *(name for row in rows for name in row[0])}, key=str)
        place = {name: i for i, name in enumerate(names)}
        precision = np.diag([self._sigma(name) ** -2 for name in names])
        weighted = np.zeros(len(names))
        for used, y, noise, _ in rows:
            at = _indicator(used, place)
            precision += np.outer(at, at) / noise**2
            weighted += at * y / noise**2
        at = _indicator(unknowns, place)
        solved = np.linalg.solve(precision, np.column_stack([weighted, at]))
        return float(at @ solved[:, 0]), float(at @ solved[:, 1])


def _indicator(unknowns: Sequence[Unknown], place: dict[Unknown, int]) -> Array:
    at = np.zeros(len(place))
    at[[place[name] for name in unknowns]] = 1.0
    return at
