"""The whole investigation, stage by stage, for any subject."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from cell.gap.diagnosis import held_out_gap, lack_of_fit
from cell.gap.diagnosis.detection_limit import detectable
from cell.gap.diagnosis.drift import drift
from cell.gap.diagnosis.invariance import Invariance, invariance
from cell.gap.diagnosis.localise import localise
from cell.gap.diagnosis.next_experiment import Advice, advise
from cell.gap.diagnosis.sparse_law import describe
from cell.gap.fitting.crossvalidation import Validated, validate
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Evidence, Model, Point, evidence
from cell.gap.fitting.projection import projection
from cell.gap.fitting.starts import refined, refit_base, refit_base_fine, refit_fine, undetermined
from cell.gap.fitting.tasks import Simulate, run_all, run_one
from cell.gap.selection import search
from cell.gap.selection.choice import Found, choose, exhausted
from cell.gap.selection.likelihood import LEVEL, LikelihoodScale, holm, likelihood_scale
from cell.gap.selection.rivals import classes, rivals
from cell.gap.selection.screening import Score, probe, ranked, ranked_pairs, table
from cell.gap.subject.subject import Experiment, Subject
from cell.gap.verdict.findings import Findings, Fitted, Judged, Screened, Shown
from drivers.types import Array

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of the whole that is done."""


def investigate(
    subject: Subject, held_out: Sequence[str], simulate: Simulate, progress: Progress, seed: int = 0
) -> Findings:
    """Find, name and show what the model of `subject` lacks; `held_out` runs only judge."""
    rng = np.random.default_rng(seed)
    train = [run for run in subject.runs if run.name not in held_out]
    test = [run for run in subject.runs if run.name in held_out]
    progress("refit the base", 0.02)
    fitted = _fit_base(subject, evidence(train), simulate, rng)
    progress("screen the candidates", 0.12)
    screened = _screen(subject, fitted, simulate)
    progress("refit the best", 0.25)
    pool = _refit(subject, fitted, screened, simulate, progress)
    better = search.better_base(simulate, pool)
    if better is not None:
        progress("begin anew from a better base", 0.3)
        fitted = _judged_base(subject, better, simulate, rng)
        screened = _screen(subject, fitted, simulate)
        pool = _refit(subject, fitted, screened, simulate, progress)
    progress("judge", 0.8)
    judged = _judge(subject, pool, simulate, rng)
    progress("show on held-out runs", 0.9)
    shown = _show(subject, simulate, fitted, judged, evidence(test), rng)
    progress("advise", 0.95)
    advice = _advise(subject, screened, judged, simulate)
    return Findings(subject, tuple(held_out), fitted, screened, judged, shown, tuple(advice))


def _fit_base(
    subject: Subject, runs: Evidence, simulate: Simulate, rng: np.random.Generator
) -> Fitted:
    rough = refit_base(simulate, Model(subject.scope.base), runs, rng)
    return _judged_base(subject, rough, simulate, rng)


def _judged_base(
    subject: Subject, rough: Estimate, simulate: Simulate, rng: np.random.Generator
) -> Fitted:
    base = refit_base_fine(subject, simulate, rough)
    inflation, noise = _inflation(base), _noise(base, rng)
    allowed = lack_of_fit.slack(base.evidence, inflation, {})
    return Fitted(
        run_one(simulate, validate(base)),
        inflation,
        drift(base),
        lack_of_fit.lack_of_fit(base, noise, allowed),
        tuple(localise(base, noise, allowed)),
        tuple(undetermined(base)),
    )


def _screen(subject: Subject, fitted: Fitted, simulate: Simulate) -> Screened:
    base = fitted.base.estimate
    about = projection(base)
    by = likelihood_scale([fitted.base])
    probed = run_all(simulate, [probe(base, c) for c in subject.scope.candidates])
    known = table(about, probed)
    singles = ranked(known)
    return Screened(
        tuple(probed),
        tuple(singles),
        tuple(ranked_pairs(known, search.SIFTED)),
        _screened_p(subject, singles, by),
        detectable(about, probed, by),
    )


def _screened_p(
    subject: Subject, singles: Sequence[Score], by: LikelihoodScale
) -> dict[str, float]:
    """Likelihood-ratio probabilities of the linear screen, family-wise over the library."""
    size = {c.name: len(c.parameters) for c in subject.scope.candidates}
    raw = {s.names[0]: stats.chi2.sf(2.0 * s.gain / by.inefficiency, size[s.names[0]])
           for s in singles}  # fmt: skip
    names = list(size)
    adjusted = holm([float(raw.get(name, 1.0)) for name in names])
    return dict(zip(names, adjusted, strict=True))


def _refit(
    subject: Subject, fitted: Fitted, screened: Screened, simulate: Simulate, progress: Progress
) -> list[Validated]:
    """Every model worth comparing, refitted: nothing more where there is nothing to find."""
    base, candidates = fitted.base, subject.scope.candidates
    by = likelihood_scale([base])
    least = by.least * by.inefficiency
    if not any(s.gain > least for s in (*screened.singles, *screened.pairs)):
        return [base]

    def tried(pool: Sequence[Validated], scores: Sequence[Score]) -> list[Validated]:
        known = search.with_shape_parameters(candidates, pool)
        more = search.fit_scores(simulate, base.estimate, scores, known)
        return search.merged(pool, more)

    pool = tried([base], screened.singles[: search.SINGLES])
    if not exhausted(pool):
        pool = search.merged(pool, search.shape_parameters(simulate, pool))
    if exhausted(pool) or not _unsettled(pool, anywhere=True):
        return pool
    progress("refit pairs", 0.45)
    pairs = search.shortlist(simulate, base.estimate, screened.pairs, candidates, search.PAIRS)
    pool = tried(pool, pairs)
    pool = tried(
        pool, search.extended(simulate, pool, 1, search.with_shape_parameters(candidates, pool))
    )
    pair = len(choose(pool).accepted.model.effects) == 2
    if pair and not exhausted(pool) and _unsettled(pool, anywhere=False):
        progress("refit triples", 0.7)
        pool = tried(
            pool, search.extended(simulate, pool, 2, search.with_shape_parameters(candidates, pool))
        )
    return tried(pool, search.without_each(pool))


def _unsettled(pool: Sequence[Validated], *, anywhere: bool) -> bool:
    """Whether the best model of the pool leaves more than noise: overall, or `anywhere`."""
    best = min(pool, key=lambda m: (m.estimate.scale, m.estimate.objective)).estimate
    noise = _noise(best, np.random.default_rng(1))
    allowed = lack_of_fit.slack(best.evidence, _inflation(best), {})
    if lack_of_fit.lack_of_fit(best, noise, allowed).p < LEVEL:
        return True
    return anywhere and any(place.p < LEVEL for place in localise(best, noise, allowed))


def _inflation(estimate: Estimate) -> dict[str, float]:
    """Factor by channel on the stated noise, of repeats whose drift, if any, is no noise."""
    change = drift(estimate)
    return change.inflation if change is not None else lack_of_fit.pure_error(estimate)


def _noise(estimate: Estimate, rng: np.random.Generator) -> Array:
    return lack_of_fit.noise_left(projection(estimate, robustly=False), rng)


def _judge(
    subject: Subject, pool: Sequence[Validated], simulate: Simulate, rng: np.random.Generator
) -> Judged:
    found = _finished(subject, simulate, choose(pool))
    best = found.accepted.estimate
    tested = [(m, e.name) for m in found.tried if _worth_testing(m, found) for e in m.model.effects]
    results = run_all(simulate, [invariance(m.estimate, e, found.by) for m, e in tested])
    invariances: dict[str, dict[str, Invariance]] = {}
    for (m, e), result in zip(tested, results, strict=True):
        invariances.setdefault(m.model.name, {})[e] = result
    tolerance = {k: q.tolerance for k, q in subject.scope.quantities.items()}
    noise, inflation = _noise(best, rng), _inflation(best)
    strict = lack_of_fit.slack(best.evidence, inflation, {})
    kind = lack_of_fit.slack(best.evidence, inflation, tolerance)
    misfit = lack_of_fit.lack_of_fit(best, noise, strict)
    kind[lack_of_fit.unshown(best)] = np.inf
    leftover, astray = _leftover(best, noise, kind)
    close = rivals(found.accepted, found.tried, found.by) if best.model.effects else []
    groups = classes(found.accepted, close)
    terms = run_all(simulate, [probe(best, t) for t in subject.scope.terms])
    law = describe(best, projection(best), terms, found.by.inefficiency, rng)
    return Judged(
        found, invariances, misfit, leftover, astray, drift(best), inflation,
        tuple(close), tuple(map(tuple, groups)), law,
    )  # fmt: skip


def _leftover(
    estimate: Estimate, noise: Array, allowed: Array
) -> tuple[lack_of_fit.Misfit, str | None]:
    """Lack of fit of all runs; where effects fit all runs but one, of the others, and that one."""
    whole = lack_of_fit.lack_of_fit(estimate, noise, allowed)
    if whole.p >= LEVEL or not estimate.model.effects:
        return whole, None
    name, samples = lack_of_fit.astray(estimate)
    others = lack_of_fit.lack_of_fit(estimate, noise, np.where(samples, np.inf, allowed))
    return (others, name) if others.p >= LEVEL else (whole, None)


def _finished(subject: Subject, simulate: Simulate, found: Found) -> Found:
    """The accepted model fitted to the end; the others are compared as they are."""
    rough = found.accepted
    if not rough.model.effects:
        return found
    done = run_one(simulate, validate(refit_fine(subject, simulate, rough.estimate)))
    tried = tuple(done if m is rough else m for m in found.tried)
    return replace(found, accepted=done, tried=tried)


def _worth_testing(model: Validated, found: Found) -> bool:
    return model is found.accepted or len(model.model.effects) == 1


def _show(
    subject: Subject,
    simulate: Simulate,
    fitted: Fitted,
    judged: Judged,
    test: Evidence,
    rng: np.random.Generator,
) -> Shown:
    def at(fit: Estimate) -> Evidence:
        return refined(subject, fit.model, Point(fit.shared, test.start()), test)

    base, best = fitted.base.estimate, judged.found.accepted.estimate
    known = at(base)
    before = after = held_out_gap.unseen(simulate, base, known)
    if best.model.effects:
        after = held_out_gap.unseen(simulate, best, Evidence(at(best).runs, known.scales))
    share = held_out_gap.shrink(
        held_out_gap.run_squares(before), held_out_gap.run_squares(after), rng
    )
    return Shown(before, after, share)


def _advise(
    subject: Subject, screened: Screened, judged: Judged, simulate: Simulate
) -> list[Advice]:
    experiments: Sequence[Experiment] = subject.experiments()
    found = judged.found
    first = found.accepted.estimate
    second = _alternative(screened, judged)
    if second is None or not experiments:
        return []
    return run_one(simulate, advise(first, second, experiments, found.by))


def _alternative(screened: Screened, judged: Judged) -> tuple[Model, Array] | None:
    """The explanation that most deserves to be told from the accepted one."""
    found = judged.found
    if judged.rivals:
        other = judged.rivals[0].model
        return other.model, other.estimate.shared
    level = len(found.accepted.model.effects) or 1
    others = [m for m in found.tried if len(m.model.effects) == level and m is not found.accepted]
    if others:
        best = min(others, key=lambda m: float(m.losses(found.by.scale).sum()))
        return best.model, best.estimate.shared
    alive = [p for p in screened.probed if not p.dead]
    if not alive:
        return None
    base = found.accepted.estimate
    candidate = alive[0].candidate
    model = Model(base.model.base, (candidate,))
    return model, np.concatenate([base.shared, np.array(candidate.probes[0][0])])
