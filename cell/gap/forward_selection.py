"""Forward selection of models: single effects first, then pairs and triples of the
best.

The models that lead the base revise it, and are fitted again beside the revised base.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from cell.gap.diagnosis.lack_of_fit import ResidualTest
from cell.gap.fitting import Progress, Simulate, run_all, run_one
from cell.gap.fitting.crossvalidation import CrossValidatedFit, validate
from cell.gap.fitting.gauss_newton import ROUGH_GAIN, FitEstimate, best, refit
from cell.gap.fitting.model import Point
from cell.gap.fitting.reml import (
    Spread,
    clearly_differ,
    estimate_spreads,
    with_spreads,
    with_unknowns,
)
from cell.gap.selection.choice import choose
from cell.gap.selection.likelihood import (
    ALPHA,
    MIN_GAIN,
    Fits,
    best_fitting,
    gain,
)
from cell.gap.selection.posterior import posterior
from cell.gap.selection.screening import ranked_pairs
from cell.gap.selection.search import BUDGET, Search, within_reach, without_each
from cell.gap.subject.subject import FitRun
from cell.gap.verdict.findings import BaseFit, Screen
from drivers.base.types import Array


class Models(NamedTuple):
    """Fitted models: that of the base, the scores of effects near it, and `fits` of all
    models so far.
    """

    base_fit: BaseFit
    screen: Screen
    fits: Fits


class BaseStart(NamedTuple):
    """Where a fit of the base starts: its runs, the values of all unknowns, and the
    runs' run-to-run spreads.
    """

    runs: Sequence[FitRun]
    point: Point
    scatter: tuple[Spread, ...]


def revised_base(
    simulate: Simulate,
    fits: Fits,
    scatter: Sequence[Spread],
    complete: Sequence[FitRun],
) -> BaseStart | None:
    """Where to fit the base again after models have beaten it: runs, start values and
    spreads; None where none has.

    `complete` are the runs with all unknowns. A base that lacks an effect takes a part
    of it for scatter, or does not see the scatter for it, and may have stopped in a
    local minimum.
    """
    leading = _leading_models(fits)
    if not leading:
        return None
    spreads = estimate_spreads(simulate, leading[0], complete)
    better = _better_base(simulate, fits, leading)
    before, now = ({s.name: s.value for s in some} for some in (scatter, spreads))
    if not better and not clearly_differ(before, now):
        return None
    start = better or fits.base
    return BaseStart(*with_unknowns(start, with_spreads(complete, spreads)), spreads)


def _leading_models(fits: Fits) -> list[CrossValidatedFit]:
    """Models that predict clearly better than the base or are more probable than it."""
    likelihood = fits.likelihood
    before_base = takewhile(lambda m: m.names, posterior(fits, likelihood).models)
    names = [m.names for m in before_base if m.p > ALPHA]
    if gain(fits.best, fits.base, likelihood) >= MIN_GAIN:
        names = [fits.best.names, *names]
    return [model for model in map(fits.of, dict.fromkeys(names)) if model]


def _better_base(
    simulate: Simulate, fits: Fits, leading: Sequence[CrossValidatedFit]
) -> FitEstimate | None:
    """Base fitted again from its values in the `leading` models; None unless it is
    clearly better than before.

    A base that stopped in a local minimum leaves a gap that is none.
    """
    base = fits.base
    model = base.model
    runs = base.runs

    tasks = []
    for fit in leading:
        values, _ = fit.values
        start = Point(values, fit.local)
        tasks.append(
            refit(
                model,
                runs,
                start,
                enough=ROUGH_GAIN,
                steps=BUDGET.short_steps,
            )
        )

    started = best([base, *run_all(simulate, tasks)])
    if started is base:
        return None

    again = refit(model, runs, started.point, started.jacobians)
    refitted = run_one(simulate, again)
    scale = min(base.scale, refitted.scale)
    is_better = refitted.objective_at(scale) < base.objective_at(scale) - MIN_GAIN
    return refitted if is_better else None


def refit_on_base(
    search: Search,
    fits: Fits,
    base: CrossValidatedFit,
    spreads: Sequence[Spread],
    complete: Sequence[FitRun],
) -> Fits:
    """Fit the models of `fits` again with the values of a new `base` and new run-to-run
    `spreads`.

    `complete` are the runs with all unknowns. Models that cannot come up to the best
    one are left out. Beside another base the other sign of an effect may fit better.
    """
    runs = base.runs
    known = fits.models
    likelihood = fits.likelihood
    tasks = []
    nats = [gain(m, fits.base, likelihood) for m in known]

    for fit, n in zip(known, nats, strict=True):
        if fit.effects and within_reach(n, max(nats)):
            _, start = with_unknowns(fit, with_spreads(complete, spreads))
            secants = _secants(fit, runs)
            tasks.append(
                refit(fit.model, runs, start, jacobians=secants, enough=ROUGH_GAIN)
            )

    estimates = run_all(search.simulate, tasks)
    refitted = run_all(search.simulate, [*map(validate, estimates)])
    fits = replace(fits, models=(base, *refitted))
    best = fits.best
    likelihood = fits.likelihood
    in_reach = [
        model for model in fits.models if gain(best, model, likelihood) <= BUDGET.reach
    ]
    return search.other_signs(fits, in_reach)


def _secants(fit: FitEstimate, runs: Sequence[FitRun]) -> Sequence[Array] | None:
    """Whitened Jacobian (samples, unknowns) of each run at `fit`, rescaled to the noise
    of `runs`; None where these have other unknowns of their own.
    """
    secants = []
    for jacobian, old, new in zip(fit.jacobians, fit.runs, runs, strict=True):
        if [p.name for p in old.local] != [p.name for p in new.local]:
            return None
        finer = old.samples.scale / new.samples.scale
        secants.append(jacobian * finer[:, None])
    return secants


def refit_singles(search: Search, models: Models, progress: Progress) -> Fits:
    """Copy of the models' fits with the best single effects fitted, if the base is
    doubted, or one of them or a pair promises enough.
    """
    progress("refit the best", 0.25)
    fits = models.fits
    least = MIN_GAIN * fits.likelihood.inefficiency
    singles = models.screen.singles
    promising = models.base_fit.doubted or any(s.gain > least for s in singles)
    if promising or ranked_pairs(models.screen.equations, among=1, least=least):
        return search.fit_scored_models(fits, singles[: BUDGET.singles])
    return fits


def refit_further(search: Search, models: Models, progress: Progress) -> Fits:
    """Copy of the models' fits with pairs and triples of effects fitted, and their
    alternatives.

    Shape parameters come first: what the law of one effect gets wrong is no second
    effect.
    """
    fits = models.fits
    if len(fits.models) == 1:
        return fits

    fits = fits.merge(search.free_shapes(fits))
    if _leaves_more(fits):
        progress("refit pairs", 0.5)
        fits = _refit_pairs(search, models.screen, fits)
    elif (accepted := _accept(fits)).effects:
        progress("screen beside the accepted effect", 0.5)
        fits = search.extend(fits, [accepted])

    accepted = _accept(fits)
    if len(accepted.effects) == 2:
        progress("refit triples", 0.7)
        fits = search.extend(fits, [accepted])

    return _refit_alternatives(search, fits)


def _refit_pairs(search: Search, screen: Screen, fits: Fits) -> Fits:
    """Fit further single effects and the most promising pairs; returns all fits."""
    scores = [s for s in screen.singles if not fits.of(frozenset(s.names))]
    scores = scores[: BUDGET.probed - BUDGET.singles]
    scores += ranked_pairs(screen.equations, BUDGET.screened_pairs)
    scores = search.shortlist(fits.base, scores, search.candidates, BUDGET.additions)
    fits = search.fit_scored_models(fits, scores)
    return search.extend(fits, fits.near_best(1)[: BUDGET.beam])


def _refit_alternatives(search: Search, fits: Fits) -> Fits:
    """Fit variants of an accepted pair or triple: without each effect, or with another
    one.

    Repeats while another set is accepted than before, since each has alternatives of
    its own. Shape parameters are free in each: beside another effect they matter that
    did not alone.
    """
    tried: set[frozenset[str]] = set()
    while len(_accept(fits).effects) > 1:
        fits = fits.merge(search.free_shapes(fits))
        accepted = _accept(fits)
        names = accepted.names
        if len(names) < 2 or names in tried:
            break

        tried.add(names)
        fits = search.fit_scored_models(fits, without_each(accepted))
        without = (fits.of(names - {name}) for name in names)
        reduced = [model for model in without if model]
        fits = search.other_signs(search.extend(fits, reduced), reduced)
    return fits


def _accept(fits: Fits) -> CrossValidatedFit:
    """Model to accept among `fits`, by the posterior probabilities of their sets of
    effects.
    """
    return choose(fits, posterior(fits, fits.likelihood))


def _leaves_more(fits: Fits) -> bool:
    """Whether the best fitting model leaves more than noise, overall or in a bin of
    samples.
    """
    best = best_fitting(fits.models)
    test = ResidualTest.of(best, np.random.default_rng(1))
    return test.misfit() < ALPHA or any(place.p < ALPHA for place in test.test_bins())
