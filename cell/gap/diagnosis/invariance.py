"""Tests of constancy: one amplitude in all conditions and phases, one base in all repeats."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import special

from cell.gap.diagnosis.lack_of_fit import pure_error
from cell.gap.fitting import normal_equations
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import request, response
from cell.gap.fitting.projection import projection, stacked_jacobian
from cell.gap.fitting.tasks import Task
from cell.gap.selection.likelihood import ALPHA, LikelihoodScale
from cell.gap.subject.subject import Run
from drivers.types import Array

DRIFT = 0.25  # relative scatter that a cause's amplitude may show; set by hand
UNSTEADY = 3.0  # times the stated noise by which repeats may differ; set by hand


@dataclass(frozen=True, slots=True)
class Invariance:
    """Test of equal amplitudes of an effect in all conditions or phases, with its p-value `p`.

    `drift` is the relative scatter of the amplitude beyond what noise explains.
    """

    effect: str
    p: float
    drift: float

    @property
    def holds(self) -> bool:
        """Whether one amplitude serves in all conditions or phases."""
        return self.p >= ALPHA or self.drift <= DRIFT


def invariance(
    estimate: Estimate, effect: str, by: LikelihoodScale, *, phases: bool = False
) -> Task[Invariance]:
    """Test an effect for equal amplitudes over conditions, or over `phases`; yields simulations.

    The residuals are regressed on the whitened response of the fitted effect, split by condition,
    with all fitted unknowns free; the test is a score test of equal amplitudes (Rao 1948; in the
    spirit of invariant prediction, Peters, Buehlmann, Meinshausen 2016).
    """
    responses = yield from _response(estimate, effect)
    about = projection(estimate)
    runs = estimate.evidence.runs
    labels = np.concatenate(
        [r.samples.phase if phases else np.full(len(r.samples), r.condition) for r in runs]
    )
    groups = list(dict.fromkeys(map(str, labels)))
    columns = np.where(labels[:, None] == np.array(groups), responses[:, None], 0.0)
    form = about.form(about.weigh(columns))
    inverse = np.linalg.pinv(form.curvature, rcond=1e-6, hermitian=True)
    amounts = -inverse @ form.gradient
    errors = np.sqrt(by.inefficiency * np.maximum(np.diag(inverse), 1e-12))
    statistic = float(form.gradient @ inverse @ form.gradient) / by.inefficiency
    freedom = np.linalg.matrix_rank(inverse, hermitian=True)
    p = float(special.chdtrc(freedom, statistic)) if len(groups) > 1 else 1.0
    if phases:  # of one motion: their amplitudes depend on one another
        return Invariance(effect, p, _joint_scatter(amounts, form.curvature / by.inefficiency))
    return Invariance(effect, p, _independent_scatter(amounts, errors))


def _response(estimate: Estimate, effect: str) -> Task[Array]:
    """Whitened residual with the effect minus without it, all else as fitted (N,)."""
    model = estimate.model
    base, effects = model.split(estimate.shared)
    null = next(e.null for e in model.effects if e.name == effect)
    without = model.join(base, {**effects, effect: null})
    runs = estimate.evidence.runs
    asked = [
        request(model, run, without, own)
        for run, own in zip(runs, estimate.point.local, strict=True)
    ]
    answers = yield asked
    parts = [
        response(here, gone, s)
        for here, gone, s in zip(estimate.raw, answers, estimate.evidence.scales, strict=True)
    ]
    return np.concatenate(parts)


def _independent_scatter(amounts: Array, errors: Array) -> float:
    """Scatter of independent amounts (k,) beyond their errors (k,) (DerSimonian and Laird 1986)."""
    if len(amounts) < 2:
        return 0.0
    w = errors**-2
    q = float(w @ (amounts - w @ amounts / w.sum()) ** 2)
    spread = (q - len(amounts) + 1) / (w.sum() - (w**2).sum() / w.sum())
    return float(np.sqrt(max(0.0, spread)))


def _joint_scatter(amounts: Array, precision: Array) -> float:
    """Scatter of correlated amounts (k,) beyond their errors, of inverse covariance `precision`.

    What they have in common is free; where an effect does nothing it has no weight.
    """
    common = precision.sum(axis=1)
    among = precision - np.outer(common, common) / max(float(common.sum()), 1e-9)
    freedom = np.linalg.matrix_rank(among, rtol=1e-6, hermitian=True)
    q, weight = float(amounts @ among @ amounts), float(np.trace(among))
    return float(np.sqrt(max(0.0, q - freedom) / weight)) if weight > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Drift:
    """Test for base parameters that change with the run index: p-value `p`, the surest in `words`.

    By channel, in units of the noise: `scatter` between repeats, `inflation` once the drift is
    taken out of them.
    """

    words: str
    p: float
    scatter: dict[str, float]
    inflation: dict[str, float]

    @property
    def real(self) -> bool:
        """Whether repeats differ by more than noise, and by a drift."""
        return self.p < ALPHA and max(self.scatter.values(), default=1.0) > 1.0


@dataclass(frozen=True, slots=True)
class Repeats:
    """Differences of repeats: their `drift` (None without any), noise `inflation` by channel."""

    drift: Drift | None
    inflation: dict[str, float]

    @classmethod
    def of(cls, estimate: Estimate) -> Self:
        """Compare the repeats in a fit; a drift does not count in their noise."""
        change = drift(estimate)
        return cls(change, pure_error(estimate) if change is None else change.inflation)

    @property
    def differ(self) -> bool:
        """Whether repeats differ, drift aside, by more than UNSTEADY times the stated noise."""
        return max(self.inflation.values(), default=1.0) > UNSTEADY

    @property
    def drifts(self) -> bool:
        """Whether the specimen changes from run to run as the model does not predict."""
        return self.drift is not None and self.drift.real


def drift(estimate: Estimate) -> Drift | None:
    """The drift of the base between repeats, or None where no condition was repeated.

    Likelihood ratio (Wilks 1938) of each parameter linear in the index, all at once, in units of
    the scatter between repeats that is left then. Only repeats are held against each other: what
    the model gets wrong of a condition is the same in all of them.
    """
    runs = estimate.evidence.runs
    later = _relative_index(runs)
    if not later.any():
        return None
    about = projection(estimate)
    count = len(estimate.shared)
    owner = np.repeat(np.arange(len(runs)), [len(r) for r in estimate.residuals])
    columns = about.weigh(stacked_jacobian(estimate)[:, :count] * later[owner][:, None])
    form = about.form(columns)
    nothing, free = np.zeros(count), np.full(count, np.inf)
    limits = normal_equations.Bounds(-free, free, nothing, nothing)
    rates = normal_equations.bounded_step(form, nothing, limits)
    corrected = (about.residual + about.left(columns) @ rates) / about.weight
    parts = np.split(corrected, np.cumsum([len(r) for r in estimate.residuals])[:-1])
    inflation = pure_error(estimate, parts, spent=count)
    unit = max([1.0, *(v / estimate.scale for v in inflation.values())]) ** 2
    p = float(special.chdtrc(count, 2.0 * normal_equations.decrease(form, rates) / unit))
    return Drift(_words(estimate, form), p, pure_error(estimate), inflation)


def _relative_index(runs: Sequence[Run]) -> Array:
    """Index (R,) of each run less the mean index of the runs of its condition."""
    index = np.array([run.index for run in runs], dtype=float)
    condition = np.array([run.condition for run in runs])
    return np.asarray(index - np.array([index[condition == own].mean() for own in condition]))


def _words(estimate: Estimate, form: normal_equations.Normal) -> str:
    """Words for the parameter whose drift alone explains most, and its change per run."""
    information = np.maximum(np.diag(form.curvature), 1e-300)
    i = int(np.argmax(form.gradient**2 / information))
    rate = -form.gradient[i] / information[i]
    p, value = estimate.model.parameters[i], float(estimate.shared[i])
    if value == 0.0:
        return f"{p.name} changes by {rate:+.2g} {p.unit} a run"
    return f"{p.name} changes by {100 * rate / value:+.2g} % a run"
