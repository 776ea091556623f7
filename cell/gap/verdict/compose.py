"""Composes the verdict document from the findings of an investigation."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy import special

from cell.gap.diagnosis import held_out_gap
from cell.gap.diagnosis.lack_of_fit import Bin, can_be_ordered
from cell.gap.fitting.crossvalidation import CrossValidatedFit
from cell.gap.fitting.gauss_newton import FitEstimate
from cell.gap.fitting.reml import Spread, covariance, degrees_of_freedom
from cell.gap.selection.likelihood import gains, holm, likelihood_ratio_p
from cell.gap.selection.screening import Score
from cell.gap.subject.subject import Candidate
from cell.gap.verdict.decision import GAP, describe_left
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import (
    CandidateEntry,
    Deviation,
    Gap,
    Interval,
    NamedEffect,
    Probable,
    ProbableSet,
    Unexplained,
    Untested,
    Verdict,
)
from drivers.strip.effects.effect import Parameter

# Limits of what a verdict lists, set by hand.
SIGNIFICANT = 0.05  # family-wise p-value below which a place is listed; customary
MOST_PLACES, MOST_SETS = 24, 20
LEAST_SEPARATION = 1.0  # sigma, of an experiment
TOLERATED = 2.0  # prior standard deviations from a value without a stated range, 95 %
NAMELESS = ("no_gap", "unexplained")  # of which what was not tested is told
HUGE = 1e12  # stands for an infinite value, which JSON cannot hold


def verdict(findings: Findings, runtime: float, simulations: int) -> Verdict:
    """Verdict on an investigation, as a document, from its `findings`, its `runtime`
    [s] and its number of `simulations`.
    """
    decision = findings.decision
    tests = findings.model_tests
    values = intervals(tests.sized, findings.likelihood.inefficiency, tests.scatter)
    effects = [
        NamedEffect(
            name=e.name,
            of=e.of,
            parameters=values[e.name],
            confidence=decision.probabilities[e.name],
        )
        for e in findings.separable
        if e not in findings.accepted.proxies
    ]
    is_sound = decision.kind == "no_gap"
    return Verdict(
        verdict=decision.kind,
        effects=[effect for effect in effects if effect.name in decision.named],
        ambiguous=[] if is_sound else [[*group] for group in tests.classes],
        unexplained=_unexplained(findings),
        base={n: v.model_copy(update={"unit": ""}) for n, v in values["base"].items()},
        where=significant(findings.places)[:MOST_PLACES],
        gap=_gap(findings),
        candidates=_candidates(findings),
        advice=[
            experiment
            for experiment in findings.experiments
            if experiment.expected_sigma >= LEAST_SEPARATION
        ],
        detectable={
            k: v for k, v in findings.screen.detectable.items() if v is not None
        },
        held_out=list(findings.held_out),
        runtime=runtime,
        simulations=simulations,
        posterior=_posterior(findings),
        suspected=[
            effect
            for effect in effects
            if effect.name not in decision.named and not is_sound
        ],
        notes=_notes(findings),
        untested=list(_untested(findings)) if decision.kind in NAMELESS else [],
    )


def intervals(
    estimate: FitEstimate, inefficiency: float, scatter: Sequence[Spread]
) -> dict[str, dict[str, Interval]]:
    """Estimated values with their 95 % intervals, as a nested mapping: by owner, which
    is `base` for the file's own parameters or the name of an effect, then by parameter.

    They cover noise, run-to-run scatter and measurement errors common to all runs; they
    are wider where few runs show how large the scatter is.
    """
    spread = np.sqrt(np.diag(covariance(estimate, inefficiency)))
    reach = special.stdtrit(degrees_of_freedom(estimate, inefficiency, scatter), 0.975)
    owners = {"base": estimate.model.base}
    owners |= {effect.name: effect.parameters for effect in estimate.effects}
    numbers = zip(estimate.shared, reach * spread, strict=False)
    return {
        owner: {p.name: _interval(p, *map(float, next(numbers))) for p in parameters}
        for owner, parameters in owners.items()
    }


def significant(places: Sequence[Bin]) -> list[Bin]:
    """Those of the groups of samples in `places` whose residuals are larger than noise
    explains.
    """
    return [place for place in places if place.p < SIGNIFICANT]


def _interval(p: Parameter, value: float, half: float) -> Interval:
    """Estimate `value` of the parameter `p` with an interval of half-width `half` about
    it, cut at the parameter's bounds, in the unit that files state.
    """
    ends = max(p.low, value - half), min(p.high, value + half)
    low, high = (
        v if np.isfinite(v) else None for v in sorted(map(p.stated_value, ends))
    )
    middle = p.stated_value(value)
    return Interval(
        value=middle if np.isfinite(middle) else HUGE, low=low, high=high, unit=p.unit
    )


def _gap(findings: Findings) -> Gap:
    """Part of the verdict on residuals of held-out runs: their sizes before and after
    effects were added, the noise, and the part of the excess that is removed.
    """
    held_out = findings.held_out_fits
    quantities = findings.quantities
    fits = (held_out.before, held_out.after)
    shrink = held_out.shrink
    before, after = (held_out_gap.sizes(fit, quantities) for fit in fits)
    floor = held_out_gap.floor(held_out.before.runs, quantities) | {"excess": 0.0}
    # a touch in all, or in none
    known = [key for key in floor if key in before and key in after]
    before, after, floor = (
        {key: sizes[key] for key in known} for sizes in (before, after, floor)
    )
    return Gap(
        before=before,
        after=after,
        floor=floor,
        shrink=shrink.value,
        shrink_low=shrink.low,
        shrink_high=shrink.high,
    )


def _unexplained(findings: Findings) -> Unexplained | None:
    """What the verdict says of residuals that no effect explains, beside named effects
    or without any; None where nothing is left.
    """
    kind = findings.decision.kind
    law = findings.law
    remains = kind == "unexplained" or findings.model_tests.remains
    if kind == "no_gap" or not remains:
        return None
    return Unexplained(
        description=describe_left(findings),
        law=law.words if law else "no sparse law found",
        stable=law is not None,
    )


def _posterior(findings: Findings) -> Probable:
    """Part of the verdict on probabilities: the most probable sets of effects, and the
    evidence by which it was decided.
    """
    posterior = findings.posterior
    probable_sets = [
        ProbableSet(names=sorted(found.names), p=found.p)
        for found in posterior.models[:MOST_SETS]
    ]
    return Probable(
        **findings.decision.evidence.model_dump(),  # what decided
        models=probable_sets,
        inclusion=posterior.inclusion,
        law=findings.law is not None,
    )


def _candidates(findings: Findings) -> list[CandidateEntry]:
    """Entries of the verdict on all tried effects, ordered by how much better each
    predicts unseen runs, the best first.
    """
    fits = findings.fits
    fitted = {model.name: model for model in fits.models if model.effects}
    raw = {
        name: likelihood_ratio_p(m, fits.base, findings.likelihood)
        for name, m in fitted.items()
    }
    p = raw | holm(
        {
            candidate.name: raw.get(candidate.name, 1.0)
            for candidate in findings.scope.candidates
        }
    )
    rows = [_compare_with_base(findings, m, p[name]) for name, m in fitted.items()]
    scores = {score.names[0]: score for score in findings.screen.singles}
    rows += [
        _compare_by_screen(findings, each.candidate, scores.get(each.name))
        for each in findings.screen.probed
        if each.name not in raw
    ]
    return sorted(rows, key=lambda row: -row.elpd_gain)


def _compare_with_base(
    findings: Findings, model: CrossValidatedFit, p: float
) -> CandidateEntry:
    """Entry of the verdict on a fitted `model`: its gain [nats] in predicting unseen
    runs over the model without effects, the standard error, p-value and parameter
    values.
    """
    likelihood = findings.likelihood
    effects = model.effects
    by_run = gains(model, findings.fits.base, likelihood)
    error = np.sqrt(len(by_run)) * by_run.std(ddof=1) if len(by_run) > 1 else 0.0
    tests = findings.model_tests
    estimate = tests.sized if model is findings.accepted else model
    values = intervals(estimate, likelihood.inefficiency, tests.scatter)
    parameters = {
        f"{effect.name}.{name}" if len(effects) > 1 else name: value
        for effect in effects
        for name, value in values[effect.name].items()
    }
    return CandidateEntry(
        name=model.name,
        elpd_gain=by_run.sum(),
        se=error,
        p=p,
        parameters=parameters,
    )


def _compare_by_screen(
    findings: Findings, candidate: Candidate, score: Score | None
) -> CandidateEntry:
    """Entry of the verdict on a `candidate` effect that was not fitted, with the gain
    [nats] that a linear estimate gave it; a `score` of None counts as no gain.
    """
    name = candidate.name
    score = score or Score((name,), gain=0.0, start={})
    start = score.start.get(name, candidate.null)
    values = zip(candidate.parameters, start, strict=True)
    stated = [(p, p.stated_value(v)) for p, v in values]
    return CandidateEntry(
        name=name,
        elpd_gain=score.gain / findings.likelihood.inefficiency,
        se=0.0,
        p=findings.screen.p.get(name, 1.0),
        parameters={
            p.name: Interval(value=value, low=None, high=None, unit=p.unit)
            for p, value in stated
            if np.isfinite(value)
        },
    )


def _untested(findings: Findings) -> Iterator[Untested]:
    """Yield what the runs of an investigation that names no effect could not have
    shown, and why.
    """
    subject = findings.subject
    runs = subject.runs
    if len({run.condition for run in runs}) == len(runs) and not can_be_ordered(runs):
        why = "no condition was repeated: a drift could not be looked for"
        yield Untested(what="drift", why=why)

    yield from (Untested(what=what, why=why) for what, why in subject.untested)
    for name in subject.scope.withheld:
        yield Untested(what=name, why="withheld from the library")

    limits = findings.screen.detectable
    for effect in subject.scope.candidates:
        name = effect.name
        limit = limits.get(name)
        if limit is None:
            yield Untested(what=name, why="shows at no possible size")
        elif not effect.is_usual(limit):
            yield Untested(what=name, why="shows beyond its usual size alone")


def _notes(findings: Findings) -> list[str]:
    """Notes of the verdict on a gap that only held-out runs show, and on predictions
    that the named effects do not improve.
    """
    decision = findings.decision
    if decision.named and decision.failure:
        return [f"{decision.failure} with what is named: it does not account for all"]
    if decision.kind != "no_gap" or decision.unseen_gap <= GAP:
        return []
    excess = held_out_gap.excess_of(findings.held_out_fits.before)
    return [
        f"held-out runs ({', '.join(findings.held_out)}) lie {excess:.2g} sigma off"
        " beyond noise, which the fitted runs do not: make these motions again, and"
        " fit all runs"
    ]


def deviations(
    base: Sequence[Parameter], fitted: Mapping[str, Interval]
) -> list[Deviation]:
    """Fitted parameters of the file whose 95 % interval does not meet the range that
    the file tolerates.
    """
    rows = []
    for p in base:
        value = fitted.get(p.name)
        if not value:
            continue
        low, high = _range_of(p)
        above = value.low is not None and value.low > high
        below = value.high is not None and value.high < low
        if above or below:
            rows.append(
                Deviation(
                    parameter=p.name,
                    stated=p.stated_value(p.start),
                    tolerated=(low, high if np.isfinite(high) else None),
                    **(value.model_dump() | {"unit": p.unit}),
                )
            )
    return rows


def _range_of(p: Parameter) -> tuple[float, float]:
    """Lower and upper end of the values of a parameter that the file tolerates, in the
    unit that files state.
    """
    if p.tolerated:
        return p.tolerated
    reach = TOLERATED * p.spread
    ends = max(p.start - reach, p.low), p.start + reach
    low, high = sorted(map(p.stated_value, ends))
    return low, high
