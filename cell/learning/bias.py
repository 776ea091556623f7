"""Hierarchical Gaussian model of a cell's bias: cell, strip, specimen, and what no camera sees.

A fold's measured minus predicted displacement is y = c + s + p + noise with the bias c of the cell,
s of the strip and p of the specimen, independent normal priors (a linear mixed model; Pinheiro and
Bates, 2000, ch. 2). A ruler measures r, the rig's error, alone. c and r begin anew where two folds
in a row show that the cell changed. One that stands alone is wild, and teaches nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.config.learning import LearningSettings
from cell.learning.experience import Experience
from drivers.types import Array

WILD = 4.0  # sigmas of one fold that is set aside until the next one comes: 6e-5 by chance
TWICE = 2.5  # sigmas of two folds in a row, to the same side, that show a change: 8e-5 by chance

Unknown = tuple[str, str | int]  # a level of the hierarchy and its member
Row = tuple[tuple[Unknown, ...], float, float]  # unknowns, their measured sum, its sigma


@dataclass(frozen=True, slots=True)
class Bias:
    """Bias of the next fold: mean and one sigma [m] of what the camera sees, and of the `rig`;
    `laid` is the offset [m] at which the cell lays edges.

    `parts` [m] are the means of cell, strip and specimen. `folds` counts the measured folds since
    the cell last changed, at the run `since`; it is None while no change was seen.
    """

    seen: float
    sigma: float
    rig: float
    parts: tuple[float, float, float]
    folds: int
    since: str | None
    laid: float = 0.0


def bias(
    experiences: Sequence[Experience], strip: str, specimen: str, settings: LearningSettings
) -> Bias:
    """Bias of a fold of `specimen`, of fabric `strip`, after `experiences` with one policy."""
    learner = _Learner(settings)
    for experience in experiences:
        learner.learn(experience)
    found = learner.bias(strip, specimen)
    if found.since is None:
        found = _unless_usual(found, learner.epoch, strip, specimen, settings)
    return replace(found, laid=laid_offset(learner.epoch, found.rig, settings))


def _unless_usual(
    found: Bias,
    experiences: Sequence[Experience],
    strip: str,
    specimen: str,
    settings: LearningSettings,
) -> Bias:
    """The mean of what is `found`, where something is `off`, and of what a right cell leaves: there
    a specimen's bias is `usual`, and the camera's own error is as large.
    """
    if not experiences:
        return found
    from scipy.special import expit, logit

    y = np.array([e.displacement for e in experiences])
    strips = np.array([e.strip for e in experiences])
    pieces = np.array([f"{e.strip}/{e.specimen}" for e in experiences])
    same = (pieces[:, None] == pieces).astype(float)
    noise = settings.repeat**2 * np.eye(len(y))
    right = (settings.usual**2 + settings.misread**2) * same + noise
    wrong = settings.cell**2 + settings.strip**2 * (strips[:, None] == strips)
    wrong = wrong + settings.specimen**2 * same + noise
    usual = settings.usual**2 * (pieces == f"{strip}/{specimen}") @ np.linalg.solve(right, y)
    p = expit(_log_density(y, wrong) - _log_density(y, right) + logit(settings.off))
    seen = float(p * found.seen + (1.0 - p) * usual)
    share = seen / found.seen if found.seen else 0.0
    cell, fabric, piece = (share * part for part in found.parts)
    return replace(found, seen=seen, parts=(cell, fabric, piece))


def _log_density(y: Array, covariance: Array) -> float:
    """Of y (n,) by a normal distribution about 0 with `covariance` (n, n), up to a constant."""
    spread = np.linalg.slogdet(covariance)[1]
    return float(-0.5 * (y @ np.linalg.solve(covariance, y) + spread))


def laid_offset(experiences: Sequence[Experience], rig: float, settings: LearningSettings) -> float:
    """Offset [m] at which a cell lays edges that the camera shows `rig` [m] too small.

    Either something is `off`, by about `changed`, or nothing is and the camera misreads each
    specimen by about `laid`: the mean over both, by their posterior (Bishop, 2006, ch. 3.4).
    """
    known = [e for e in experiences if e.edges is not None and abs(e.edges) < settings.limit]
    if not known:
        return 0.0
    from scipy.special import expit, logit

    seen = np.array([e.edges for e in known], dtype=float) + rig
    names = np.array([f"{e.strip}/{e.specimen}" for e in known])
    covariance = settings.laid**2 * (names[:, None] == names) + settings.repeat**2 * np.eye(
        len(seen)
    )
    weights = np.linalg.solve(covariance, np.ones(len(seen)))
    variance = 1.0 / (weights.sum() + settings.changed**-2)
    mean = variance * float(weights @ seen)
    evidence = 0.5 * (np.log(variance / settings.changed**2) + mean**2 / variance)
    return float(mean * expit(evidence + logit(settings.off)))


class _Learner:
    """Experiences in order, cut into epochs between which the cell did not change."""

    def __init__(self, settings: LearningSettings) -> None:
        self._settings = settings
        self._rows: list[Row] = []
        self._runs: list[str] = []  # that began an epoch, from the second on
        self._epoch_folds: list[int] = []  # rows of the folds of this epoch
        self.epoch: list[Experience] = []  # these folds
        self._before: tuple[float, Experience] | None = None  # surprise of the fold before

    def learn(self, experience: Experience) -> None:
        """Add the next experience; begin an epoch where it and the one before disagree with all."""
        if experience.kind == "ruler":
            self._rows.append(((self._rig,), experience.rig, self._settings.ruler))
            return
        surprise, before = self._surprise(experience), self._before
        self._before = (surprise, experience)
        if before and min(abs(surprise), abs(before[0])) > TWICE and surprise * before[0] > 0:
            self._begin(*before)
            self._before = None
        elif abs(surprise) > WILD:
            return
        self._add(experience)

    def _begin(self, surprise: float, first: Experience) -> None:
        """An epoch that begins with the fold before, which differed by `surprise`."""
        if abs(surprise) <= WILD:
            self._rows.pop(self._epoch_folds[-1])
        self._runs.append(first.run)
        self._epoch_folds, self.epoch = [], []
        self._add(first)

    def _surprise(self, experience: Experience) -> float:
        """Sigmas by which a fold differs from the bias so far; 0 for the first of an epoch."""
        if not self._epoch_folds:
            return 0.0
        mean, variance = self._predict(self._of(experience.strip, experience.specimen))
        sigma = np.hypot(np.sqrt(variance), self._settings.repeat)
        return float((experience.displacement - mean) / sigma)

    def _add(self, experience: Experience) -> None:
        self._epoch_folds.append(len(self._rows))
        self.epoch.append(experience)
        unknowns = self._of(experience.strip, experience.specimen)
        self._rows.append((unknowns, experience.displacement, self._settings.repeat))

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


def _indicator(unknowns: Sequence[Unknown], place: dict[Unknown, int]) -> Array:
    at = np.zeros(len(place))
    at[[place[name] for name in unknowns]] = 1.0
    return at
