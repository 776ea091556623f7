"""Invariance test: a cause has one amplitude in all conditions and phases, a proxy has not."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import request, response
from cell.gap.fitting.projection import projection
from cell.gap.fitting.tasks import Task
from cell.gap.selection.likelihood import ALPHA, LikelihoodScale
from drivers.types import Array

DRIFT = 0.25  # relative scatter that a cause's amplitude may show; set by hand


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
