"""What must not decide a verdict: a wild sample, a lost base, repeats that scatter."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from cell.gap.fitting.base_fit import refit_fine
from cell.gap.fitting.crossvalidation import folds
from cell.gap.fitting.gauss_newton import FitEstimate, _next_use
from cell.gap.subject.subject import FitRun, SimulationRequest
from cell.gap.verdict.decision import decide, describe_left
from drivers.base.types import Array
from tests.support.curves import (
    Curves,
    T,
    fitted,
    hidden,
    judged,
    nothing,
    validated,
    wave,
)

GRAIN = 0.1


def once(t: Array, _: float, index: int) -> Array:
    return np.where((t == T[40]) & (index == 2), 0.5, 0.0)


def test_one_wild_sample_claims_no_gap() -> None:
    found, verdict = judged(Curves(once))
    assert abs(found.base_fit.places[0].z) > 10.0
    assert verdict.verdict == "no_gap"


def test_repeats_that_scatter_for_no_reason_leave_the_cause_open() -> None:
    _, verdict = judged(Curves(hidden(wave, 0.3), repeats=4, scatter=0.2))
    assert verdict.verdict == "unexplained"
    assert "repeats of one condition differ by" in verdict.unexplained.description


def test_a_jacobian_is_mended_once_and_then_made_anew() -> None:
    used = [_next_use(0.5, use) for use in ("new", "kept", "mended")]
    assert used == ["mended", "mended", "new"]


def test_loss_of_runs_left_out_is_that_of_their_normal_density() -> None:
    model = validated(fitted(Curves(nothing, repeats=2)))
    runs = model.runs
    rng, count = np.random.default_rng(0), len(runs)
    r = rng.uniform(-0.5, 0.5, (count, len(T)))
    b = rng.uniform(-0.1, 0.1, (count, len(T), 2))
    model = replace(model, left_out=r, uncertain=b, charged=np.zeros(count))
    for fold in folds(runs):
        beside = np.concatenate(b[fold])
        density = stats.multivariate_normal(cov=np.eye(len(beside)) + beside @ beside.T)
        of_noise = len(beside) * stats.norm.logpdf(0.0)
        exact = of_noise - density.logpdf(np.concatenate(r[fold]))
        assert model.losses(1.0)[fold].sum() == pytest.approx(exact)


class Grained(Curves):
    """Curves whose simulation turns out coarse: no model gets them right below
    `GRAIN`.
    """

    def grain(self, _: SimulationRequest) -> float:
        return GRAIN

    def refine(self, requests: Sequence[SimulationRequest]) -> Sequence[FitRun]:
        return [
            replace(
                q.run, samples=replace(q.run.samples, floor=np.full(60, self.grain(q)))
            )
            for q in requests
        ]


def counts_grain(fit: FitEstimate) -> bool:
    samples = fit.runs[0].samples
    return samples.scale == pytest.approx(np.hypot(samples.noise, GRAIN))


def test_what_the_grain_of_a_model_leaves_is_no_gap_and_it_is_fitted_by_its_own():
    _, verdict = judged(Grained(hidden(wave, 0.01)))
    assert verdict.verdict == "no_gap"
    assert judged(Curves(hidden(wave, 0.01)))[1].verdict == "named"
    subject = Grained(hidden(wave, 0.3))
    for rough in (fitted(subject), fitted(subject, ("wave",))):
        fine = refit_fine(
            subject, subject.simulate, rough.model, rough.runs, rough.point
        )
        assert counts_grain(fine)


class GrainedBeside(Grained):
    """Curves whose simulation is coarse beside an effect alone."""

    def grain(self, q: SimulationRequest) -> float:
        return GRAIN if q.effects else 0.0


def test_gaps_on_held_out_runs_are_compared_by_the_floors_of_both_models() -> None:
    subject = GrainedBeside(hidden(wave, 0.3))
    shown = judged(subject)[0].held_out_fits
    assert shown.after.model.names == {"wave"}
    for fit in (shown.before, shown.after):
        assert counts_grain(fit)


def test_a_model_that_leaves_more_of_unseen_runs_is_the_less_probable() -> None:
    found, verdict = judged(Curves(hidden(wave, 0.3)))
    assert verdict.verdict == "named"
    fits = found.held_out_fits
    worse = replace(
        found, held_out_fits=replace(fits, before=fits.after, after=fits.before)
    )
    decision = decide(worse)
    assert decision.probabilities["wave"] < verdict.effects[0].confidence
    assert decision.kind == "unexplained"
    worse = replace(worse, decision=decision)
    assert "has not seen is predicted worse" in describe_left(worse)
