"""Hierarchical Gaussian model of the bias of folds: of cell, strip, specimen, and error
of the rig.

A fold's measured minus predicted displacement is y = c + s + p + noise with the bias c
of the cell, s of the strip and p of the specimen, independent normal priors (a linear
mixed model; Pinheiro and Bates, 2000, ch. 2). A ruler measures r, the rig's error,
alone. c and r begin anew where two folds in a row show that the cell changed. A fold
that deviates alone is an outlier, and left out.

Most cells and specimens have no bias of their own: until the cell changes, each is the
mean over two hypotheses, that something is off and that nothing is, weighted by their
posterior probabilities (Bayesian model averaging; Hoeting et al., 1999, Statistical
Science 14).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from cell.folding.experience import Experience
from drivers.base.errors import ConfigurationError, in_mm
from drivers.base.types import Array

# sigmas of one fold that is ignored unless the next one confirms it: 6e-5 by chance
OUTLIER_SIGMAS = 4.0
# sigmas of two folds in a row, to the same side, that show a change: 8e-5 by chance
CHANGE_SIGMAS = 2.5
PLAUSIBLE_SIGMAS = 3.0  # of the difference between camera and ruler
# One-sigma priors [m]. They are assumptions, about the accuracy of a careful set-up,
# and belong to no cell; where one rests on a measurement, its comment says on which.
# rig: seen by no image
PRIORS = {"cell": 0.001, "strip": 0.001, "specimen": 0.001, "rig": 0.003}
CHANGED = 0.003  # of the cell after something moved
REPEAT = 0.0003  # of a specimen's folds; 0.2 mm on the twin
RULER = 0.0005  # of an edge offset read by eye
LAID = 0.0006  # of laid edges by camera; laid_fold.yaml: 0.44 mm
USUAL = 0.0004  # of specimens in a right cell; critic's left_out
MISREAD = 0.00025  # of a specimen's touch by the camera
OFF = 0.2  # share of cells and specimens with something off
LIMIT = 0.008  # m, of the correction

Unknown = tuple[str, str | int]  # a level of the hierarchy and its member
# unknowns, their measured sum, its sigma
Row = tuple[tuple[Unknown, ...], float, float]
Parts = tuple[float, float, float]  # m, of cell, strip and specimen


@dataclass(frozen=True, slots=True)
class Bias:
    """What is expected of the next fold's displacement beyond the predicted one, in
    metres: the mean `seen` by the camera, its standard deviation `sigma`, and the mean
    error `rig` of the camera's measurement.

    `laid` is the offset [m] at which the cell lays edges. `parts` [m] are the means of
    cell, strip and specimen. `folds` counts the measured folds since the cell last
    changed, at the run `since`; None without a detected change.
    """

    seen: float
    sigma: float
    rig: float
    parts: Parts
    folds: int
    since: str | None
    laid: float = 0.0


def bias(experiences: Sequence[Experience], strip: str, specimen: str) -> Bias:
    """Expected deviation [m] of the next fold of `specimen`, a piece of the fabric
    `strip`, learned from `experiences` of folds with one policy.
    """
    learner = _Learner()
    for experience in experiences:
        learner.learn(experience)
    learned = learner.bias(strip, specimen)
    if learned.since is None and learner.epoch:
        parts = _averaged_parts(learned.parts, learner.epoch, strip, specimen)
        learned = replace(learned, seen=sum(parts), parts=parts)
    return replace(learned, laid=laid_offset(learner.epoch, learned.rig))


class _Learner:
    """Estimator that learns how far folds deviate from their prediction, and starts
    anew wherever the cell seems to have changed.
    """

    def __init__(self) -> None:
        self._rows: list[Row] = []
        self._change_runs: list[str] = []  # names of the runs that began a new epoch
        self._epoch_rows: list[int] = []  # indices into `_rows` of this epoch's folds
        # this epoch's folds, in the order of `_epoch_rows`
        self.epoch: list[Experience] = []
        # the last fold and its surprise [sigmas]; None before the first and after a
        # change
        self._previous_fold: tuple[float, Experience] | None = None

    def learn(self, experience: Experience) -> None:
        """Learn from one more fold; two successive folds that deviate to the same side
        mean that the cell has changed.
        """
        if experience.kind == "ruler":
            self._rows.append(((self._rig,), experience.rig, RULER))
            return

        surprise = self._surprise(experience)
        before = self._previous_fold
        self._previous_fold = (surprise, experience)
        if (
            before is not None  # two folds in a row deviate to the same side
            and min(abs(before[0]), abs(surprise)) > CHANGE_SIGMAS
            and before[0] * surprise > 0
        ):
            self._start_epoch(*before)
            self._previous_fold = None
        elif abs(surprise) > OUTLIER_SIGMAS:
            return

        self._add(experience)

    def _start_epoch(self, surprise: float, first: Experience) -> None:
        """Begin to learn anew with the fold `first`, which deviated from what was
        learned by `surprise` standard deviations.
        """
        if abs(surprise) <= OUTLIER_SIGMAS:
            self._rows.pop(self._epoch_rows[-1])
        self._change_runs.append(first.run)
        self._epoch_rows = []
        self.epoch = []
        self._add(first)

    def _surprise(self, experience: Experience) -> float:
        """By how many standard deviations a fold deviates from what was learned before;
        zero for the first fold since the cell changed.
        """
        if not self._epoch_rows:
            return 0.0
        mean, variance = self._predict(
            self._unknowns_of(experience.strip, experience.specimen)
        )
        sigma = np.hypot(np.sqrt(variance), REPEAT)
        return float((experience.displacement - mean) / sigma)

    def _add(self, experience: Experience) -> None:
        """Add a fold to those since the cell last changed."""
        self._epoch_rows.append(len(self._rows))
        self.epoch.append(experience)
        unknowns = self._unknowns_of(experience.strip, experience.specimen)
        self._rows.append((unknowns, experience.displacement, REPEAT))

    def bias(self, strip: str, specimen: str) -> Bias:
        """Expected displacement of the next fold of a `specimen` of the fabric `strip`
        beyond the predicted one, with its uncertainty.
        """
        unknowns = self._unknowns_of(strip, specimen)
        mean, variance = self._predict(unknowns)
        rig, _ = self._predict((self._rig,))
        each = [self._predict((unknown,))[0] for unknown in unknowns]
        return Bias(
            seen=mean,
            sigma=float(np.hypot(np.sqrt(variance), REPEAT)),
            rig=rig,
            parts=(each[0], each[1], each[2]),
            folds=len(self._epoch_rows),
            since=self._change_runs[-1] if self._change_runs else None,
        )

    @property
    def _rig(self) -> Unknown:
        """Name, in the linear model of biases, of the camera's measurement error since
        the cell last changed.
        """
        return ("rig", len(self._change_runs))

    def _unknowns_of(self, strip: str, specimen: str) -> tuple[Unknown, ...]:
        """Names, in the linear model of biases, of the three that add up in a fold:
        those of the cell, the strip and the specimen.
        """
        return (
            ("cell", len(self._change_runs)),
            ("strip", strip),
            ("specimen", f"{strip}/{specimen}"),
        )

    def _sigma(self, unknown: Unknown) -> float:
        """Standard deviation [m] that is assumed for the bias named `unknown` before
        any fold was measured.
        """
        level, member = unknown
        if level == "cell" and member != 0:
            return CHANGED
        return PRIORS[level]

    def _predict(self, unknowns: tuple[Unknown, ...]) -> tuple[float, float]:
        """Mean [m] and variance [m^2] of the sum of the biases named in `unknowns`,
        given all folds that were learned.

        Bayesian linear regression: A = diag(1 / sigma^2) + sum h h' / noise^2 over the
        folds, b = sum h y / noise^2; the mean is g' A^-1 b, the variance g' A^-1 g.
        """
        names = sorted({*unknowns}.union(*(used for used, *_ in self._rows)), key=str)
        columns = {name: i for i, name in enumerate(names)}
        precision = np.diag([self._sigma(name) ** -2 for name in names])
        weighted = np.zeros(len(names))
        for used, y, noise in self._rows:
            h = _indicator(used, columns)
            precision += np.outer(h, h) / noise**2
            weighted += h * y / noise**2

        g = _indicator(unknowns, columns)
        solved = np.linalg.solve(precision, np.column_stack([weighted, g]))
        return float(g @ solved[:, 0]), float(g @ solved[:, 1])


def _indicator(unknowns: Sequence[Unknown], columns: dict[Unknown, int]) -> Array:
    """Vector with ones at the `columns` of the named `unknowns`, and zeros
    elsewhere.
    """
    row = np.zeros(len(columns))
    row[[columns[name] for name in unknowns]] = 1.0
    return row


def _averaged_parts(
    parts: Parts, experiences: Sequence[Experience], strip: str, specimen: str
) -> Parts:
    """Mean biases [m] of cell, strip and specimen, averaged over the hypotheses that
    something is off and that nothing is.

    If nothing is off, cell and strip have no bias, a specimen has a USUAL one, and the
    camera adds an error of its own to each specimen.
    """
    y = np.array([e.displacement for e in experiences])
    strips = np.array([e.strip for e in experiences])
    pieces = _specimens(experiences)
    same = (pieces[:, None] == pieces).astype(float)

    # covariances of y: if nothing is off, and if something is
    noise = REPEAT**2 * np.eye(len(y))
    null = (USUAL**2 + MISREAD**2) * same + noise
    off = PRIORS["cell"] ** 2 + PRIORS["strip"] ** 2 * (strips[:, None] == strips)
    off = off + PRIORS["specimen"] ** 2 * same + noise

    usual = USUAL**2 * (pieces == f"{strip}/{specimen}") @ np.linalg.solve(null, y)
    p_off = _probability_off(y, null, off)
    cell_bias, strip_bias, specimen_bias = (float(p_off * part) for part in parts)
    return cell_bias, strip_bias, specimen_bias + float((1.0 - p_off) * usual)


def laid_offset(experiences: Sequence[Experience], rig: float) -> float:
    """Mean offset [m] at which the cell lays the strip's edges on each other, estimated
    from `experiences`, whose camera reads `rig` [m] too little; zero without data.

    Weighs two models with prior odds OFF: an offset of about CHANGED, or none and an
    error of the camera of about LAID for each specimen.
    """
    seen_edges = [
        e for e in experiences if e.edges is not None and abs(e.edges) < LIMIT
    ]
    if not seen_edges:
        return 0.0
    seen = np.array([e.edges for e in seen_edges], dtype=float) + rig
    pieces = _specimens(seen_edges)
    # covariances of the measured offsets: without and with a fault of the rig
    null = LAID**2 * (pieces[:, None] == pieces)
    null = null + REPEAT**2 * np.eye(len(seen))
    off = null + CHANGED**2
    weights = np.linalg.solve(null, np.ones(len(seen)))
    variance = 1.0 / (weights.sum() + CHANGED**-2)
    mean: float = variance * float(weights @ seen)
    return mean * _probability_off(seen, null, off)


def check_ruler(edges: float, rig: float) -> None:
    """Raise ConfigurationError where the offset `edges` [m] of laid edges by a ruler,
    which is `rig` [m] more than that by the camera, differs too much from it.

    Too much is PLAUSIBLE_SIGMAS of what both err by in a right rig: an error of the rig
    and a slip of the decimal point look alike, so that a larger one is to be confirmed.
    """
    most = PLAUSIBLE_SIGMAS * hypot(LAID, RULER)
    if abs(rig) > most:
        raise ConfigurationError(
            f"--edges: {1e3 * edges:g} mm is {1e3 * rig:+.1f} mm from the"
            f" {1e3 * (edges - rig):+.1f} mm that the camera saw, and a right rig"
            f" shows {in_mm(most, 1)} at most; mind sign, decimal point and unit,"
            " measure again, and add --sure if it is so"
        )


def _specimens(experiences: Sequence[Experience]) -> Array:
    """Array with the name of the piece of fabric, and of its strip, in each of
    `experiences`.
    """
    return np.array([f"{e.strip}/{e.specimen}" for e in experiences])


def _probability_off(y: Array, null: Array, off: Array) -> float:
    """Probability that the values `y` have the covariance `off` rather than `null`,
    both matrices with a row and a column for each value.
    """
    from scipy.special import expit, logit

    odds = _log_density(y, off) - _log_density(y, null) + logit(OFF)
    return float(expit(odds))


def _log_density(y: Array, covariance: Array) -> float:
    """Logarithm of the density of the values `y`, normally distributed about zero with
    the given `covariance`, up to a constant.
    """
    spread = np.linalg.slogdet(covariance)[1]
    return float(-0.5 * (y @ np.linalg.solve(covariance, y) + spread))
